"""What hardware does to a network, as a network again."""
