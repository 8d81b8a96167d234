"""What the benchmarks beside this folder compute with."""
