-- A migration locks one of the tables that submissions and claims write: those take them in different orders, and others go on
-- meanwhile. What concerns `jobs` is 0007.
--
-- Among tenants with as few jobs running, whoever was served longest ago is next: a tenant that fills the queue keeps nobody
-- out who comes later, even where one worker claims, or where more tenants wait than there are workers.

-- Which of all claims was a tenant's last. It stays when the tenant's lanes are empty: whoever submits one job after another
-- is no newcomer each time. Written by whoever holds the tenant's turn.
CREATE TABLE served (
    tenant  TEXT COLLATE "C" PRIMARY KEY,
    claim   BIGINT NOT NULL
) WITH (fillfactor = 50);

CREATE SEQUENCE claims;

ALTER TABLE lanes ADD COLUMN served BIGINT NOT NULL DEFAULT 0;
DROP INDEX lanes_next;
CREATE INDEX lanes_next ON lanes (priority DESC, served, created, id);

CREATE FUNCTION remember_served() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    new.served := COALESCE((SELECT claim FROM served WHERE tenant = new.tenant), 0);
    RETURN new;
END $$;

-- A lane that begins anew, whoever begins it.
CREATE TRIGGER lanes_remember BEFORE INSERT ON lanes FOR EACH ROW EXECUTE FUNCTION remember_served();

-- A lane that a submission writes in this moment is passed over, and not waited for: two that hold a lane each and want the
-- other's would wait for ever. It is told at the tenant's next claim.
CREATE FUNCTION serve(of_tenant TEXT) RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    own CONSTANT BIGINT := nextval('claims');
BEGIN
    INSERT INTO served (tenant, claim) VALUES (of_tenant, own) ON CONFLICT (tenant) DO UPDATE SET claim = excluded.claim;
    UPDATE lanes SET served = own FROM (
        SELECT priority FROM lanes WHERE tenant = of_tenant FOR UPDATE SKIP LOCKED
    ) AS free WHERE lanes.tenant = of_tenant AND lanes.priority = free.priority;
END $$;

-- A job that is given back is as if it had never been claimed, and so is its tenant (0007).
CREATE FUNCTION unserve() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    UPDATE served SET claim = 0 WHERE tenant = new.tenant;
    UPDATE lanes SET served = 0 FROM (
        SELECT priority FROM lanes WHERE tenant = new.tenant FOR UPDATE SKIP LOCKED
    ) AS free WHERE lanes.tenant = new.tenant AND lanes.priority = free.priority;
    RETURN NULL;
END $$;

-- As before (0001), by priority, then by how few jobs of its tenant run, then by how long ago its tenant was served, then by age.
CREATE OR REPLACE FUNCTION claim_job(by_worker TEXT, lease_ms BIGINT, most_running BIGINT, wait_for TEXT)
RETURNS TABLE (claimed jobs, request BYTEA, busy TEXT) LANGUAGE plpgsql
SET enable_seqscan = off SET enable_bitmapscan = off SET enable_hashjoin = off SET enable_mergejoin = off AS $$
#variable_conflict use_column
DECLARE
    lane RECORD;
    head jobs;
    asked BYTEA;
    at BIGINT;
    running_now BIGINT;
    locked TEXT;
    again BOOLEAN;
BEGIN
    IF wait_for IS NOT NULL THEN
        PERFORM pg_advisory_xact_lock(turn_key(wait_for));
    END IF;
    PERFORM make_due_ready(32);
    FOR round IN 1 .. 8 LOOP
        again := false;
        locked := NULL;
        FOR lane IN
            SELECT * FROM (
                (SELECT tenant, priority, created, id, served, 0::bigint AS running FROM lanes
                 WHERE NOT EXISTS (SELECT 1 FROM leases WHERE leases.tenant = lanes.tenant)
                 ORDER BY priority DESC, served, created, id LIMIT 32)
                UNION ALL
                (SELECT lanes.tenant, lanes.priority, lanes.created, lanes.id, lanes.served, held.running
                 FROM (SELECT tenant, count(*) AS running FROM leases GROUP BY tenant) AS held
                 JOIN lanes ON lanes.tenant = held.tenant
                 WHERE held.running < most_running)
            ) AS candidate
            WHERE running < most_running
            ORDER BY priority DESC, running, served, created, id LIMIT 64
        LOOP
            IF NOT pg_try_advisory_xact_lock(turn_key(lane.tenant)) THEN
                locked := COALESCE(locked, lane.tenant);
                CONTINUE;
            END IF;
            PERFORM 1 FROM lanes WHERE tenant = lane.tenant AND priority = lane.priority FOR UPDATE SKIP LOCKED;
            IF NOT FOUND THEN
                again := true;
                CONTINUE;
            END IF;
            SELECT count(*) INTO running_now FROM leases WHERE tenant = lane.tenant;
            IF running_now >= most_running OR (running_now > lane.running AND round < 8) THEN
                again := again OR running_now < most_running;
                CONTINUE;
            END IF;
            SELECT * INTO head FROM jobs
            WHERE status = 'accepted' AND not_before = 0 AND tenant = lane.tenant AND priority = lane.priority
            ORDER BY created, id LIMIT 1 FOR UPDATE SKIP LOCKED;
            IF NOT FOUND OR ((head.created, head.id) > (lane.created, lane.id) AND round < 8) THEN
                -- The lane promised an older job than there is.
                PERFORM advance_lane(lane.tenant, lane.priority);
                again := true;
                EXIT;
            END IF;
            at := now_ms();
            UPDATE jobs SET status = 'running', attempt = attempt + 1, revision = revision + 1, updated = at,
                            started = COALESCE(started, at)
            WHERE id = head.id RETURNING * INTO head;
            INSERT INTO leases (job_id, tenant, attempt, worker, lease_until)
            VALUES (head.id, head.tenant, head.attempt, by_worker, at + lease_ms);
            PERFORM serve(lane.tenant);
            PERFORM advance_lane(lane.tenant, lane.priority);
            SELECT r.request INTO asked FROM requests AS r WHERE r.job_id = head.id;
            RETURN QUERY SELECT head, asked, NULL::text;
            RETURN;
        END LOOP;
        EXIT WHEN NOT again;
    END LOOP;
    IF again OR locked IS NOT NULL THEN
        RETURN QUERY SELECT NULL::jobs, NULL::bytea, locked;
    END IF;
END $$;
