"""Config models: the immutable, validated parts that scenes are made of."""
