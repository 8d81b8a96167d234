"""What presses and rubs: tools, sheets, holders."""
