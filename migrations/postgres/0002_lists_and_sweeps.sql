-- Pages of lists go by indexes that nothing else can stand in for, retention goes by age.

-- In one direction throughout, so that a page can ask for what lies before a tenant, a status and an id together. The planner,
-- asked for the next id of a tenant and a status, would rather walk the primary key backwards until one fits: for a
-- status that few jobs have, through all of them.
DROP INDEX jobs_by_tenant;
CREATE INDEX jobs_by_tenant ON jobs (tenant, id);
DROP INDEX jobs_by_status;
CREATE INDEX jobs_by_status ON jobs (tenant, status, id);
DROP INDEX maps_by_tenant;
CREATE INDEX maps_by_tenant ON maps (tenant, id, min_x, min_y, max_x, max_y);

-- What is kept no longer is the oldest.
CREATE INDEX maps_by_age ON maps (created, id);
