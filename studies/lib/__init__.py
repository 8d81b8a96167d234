"""What single studies compute, beside the scripts that people run."""
