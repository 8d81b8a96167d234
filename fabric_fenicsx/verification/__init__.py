"""What studies compute to judge results: theory, reference solutions, errors, hard cases."""
