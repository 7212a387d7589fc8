"""What the reduction found, in words and tables."""
