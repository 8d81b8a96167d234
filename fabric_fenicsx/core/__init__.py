"""What all rooms share: errors, declared quantities, tables, files, ranks, signals, timing."""
