"""What a network computes: one contract, one evaluator an array library."""
