"""Contact and friction of sheets with tools, holders and each other."""
