"""A track judged without truth, and its report: one page with a player, the video and curves."""
