"""Results of each benchmark as Markdown tables."""
