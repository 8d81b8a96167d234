"""Results of runs: numbers, fields, wrinkles, flat patterns, exports, pictures, reports."""
