"""What a sheet resists with: membrane, bending, metal."""
