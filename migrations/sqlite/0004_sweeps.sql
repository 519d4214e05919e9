-- What is kept no longer is the oldest; and whose artifacts are is asked by their prefix.
CREATE INDEX maps_by_age ON maps (created, id);
CREATE INDEX maps_by_prefix ON maps (prefix);
