"""Jobs: a scene brought to full load, and its error."""
