"""What each benchmark's cases say, as Markdown tables."""
