"""Is it the optimum? Judged by the problem alone."""
