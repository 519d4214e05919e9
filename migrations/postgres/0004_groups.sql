-- Submissions come in groups: what a job's arrival is counted by is written once a statement and tenant, not once a job.

CREATE FUNCTION hold_arrivals() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    -- In one order, so that no two groups wait for each other.
    PERFORM hold(tenant, jobs, 0, 0)
    FROM (SELECT tenant, count(*) AS jobs FROM arrived WHERE status = 'accepted' GROUP BY tenant ORDER BY tenant) AS each;
    RETURN NULL;
END $$;

DROP TRIGGER holdings_submitted ON jobs;
CREATE TRIGGER holdings_submitted AFTER INSERT ON jobs REFERENCING NEW TABLE AS arrived
FOR EACH STATEMENT EXECUTE FUNCTION hold_arrivals();

-- What join_lane does for a job, for the first of each lane: those behind it find the lane.
CREATE FUNCTION join_lanes() RETURNS trigger LANGUAGE plpgsql AS $$
DECLARE
    first RECORD;
    head BIGINT;
    wake BOOLEAN := false;
BEGIN
    FOR first IN
        SELECT DISTINCT ON (tenant, priority) tenant, priority, created, id FROM arrived
        WHERE status = 'accepted' AND not_before = 0 ORDER BY tenant, priority, created, id
    LOOP
        PERFORM pg_advisory_xact_lock_shared(lanes_key(first.tenant));
        SELECT created INTO head FROM lanes
        WHERE tenant = first.tenant AND priority = first.priority AND (created, id) <= (first.created, first.id);
        IF NOT FOUND THEN
            INSERT INTO lanes (tenant, priority, created, id)
            VALUES (first.tenant, first.priority, first.created, first.id)
            ON CONFLICT (tenant, priority) DO UPDATE SET created = excluded.created, id = excluded.id
                WHERE (excluded.created, excluded.id) < (lanes.created, lanes.id);
        END IF;
        wake := wake OR head IS NULL OR head > first.created - 2000;
    END LOOP;
    -- As in join_lane: where a job has waited for seconds nobody is idle.
    IF wake THEN
        PERFORM pg_notify('mapfit_jobs', '');
    END IF;
    RETURN NULL;
END $$;

DROP TRIGGER lanes_submitted ON jobs;
CREATE TRIGGER lanes_submitted AFTER INSERT ON jobs REFERENCING NEW TABLE AS arrived
FOR EACH STATEMENT EXECUTE FUNCTION join_lanes();
