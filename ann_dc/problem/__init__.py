"""What is to be solved: the declaration, its functions and starts, the plants, problem files."""
