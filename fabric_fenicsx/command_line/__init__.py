"""Command lines, outermost: options, what is printed, exit status. Nothing that computes imports
it."""
