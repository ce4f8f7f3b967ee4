"""What is known at a state of a network without running it."""
