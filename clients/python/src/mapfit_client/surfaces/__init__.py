"""The surfaces a map says there are, the distance to them, and where anything was seen at all."""
