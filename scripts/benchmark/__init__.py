"""What the benchmark, the accuracy figures and the tests against Cycles have in common."""
