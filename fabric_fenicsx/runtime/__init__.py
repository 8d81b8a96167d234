"""The process of a run: errors, ranks, signals, files, timing, declared fields."""
