"""What a run needs of its process: errors, ranks, signals, files, timing, declared fields."""
