-- Jobs and the queue they wait in, maps, places, keys, webhooks.
--
-- Times are milliseconds since 1970 by the database's clock. Text is compared bytewise (COLLATE "C"), so that ids order as
-- they were made, whatever the database's locale. JSON is kept as text: it comes back as it was written, numbers too.
--
-- Many processes write at once, so there is an order in which a transaction takes locks: a job's row, its lease, the queue it
-- waits in. Where one transaction has several jobs or queues it skips what others hold instead of waiting (SKIP LOCKED, and
-- pg_try_advisory_xact_lock), so no two can wait for each other.

CREATE FUNCTION now_ms() RETURNS BIGINT LANGUAGE sql VOLATILE
RETURN (extract(epoch FROM clock_timestamp()) * 1000)::bigint;

CREATE TABLE jobs (
    id          TEXT COLLATE "C" PRIMARY KEY,
    tenant      TEXT COLLATE "C" NOT NULL,
    name        TEXT,
    labels      TEXT NOT NULL,
    status      TEXT COLLATE "C" NOT NULL
                CHECK (status IN ('accepted', 'running', 'successful', 'failed', 'dismissed')),
    progress    TEXT NOT NULL,
    message     TEXT,
    problem     TEXT,
    created     BIGINT NOT NULL,
    started     BIGINT,
    finished    BIGINT,
    updated     BIGINT NOT NULL,
    attempt     BIGINT NOT NULL DEFAULT 0,
    priority    INTEGER NOT NULL DEFAULT 0,
    map_id      TEXT COLLATE "C",
    revision    BIGINT NOT NULL DEFAULT 1,
    not_before  BIGINT NOT NULL DEFAULT 0,
    retry_of    TEXT COLLATE "C",
    -- Past it the job has failed.
    deadline    BIGINT
) WITH (fillfactor = 85, autovacuum_vacuum_scale_factor = 0.02, autovacuum_analyze_scale_factor = 0.05);

-- A job is ready when it is accepted and not_before is 0. A retried job waits with its time in not_before; a claim
-- first sets those that are due to 0, and then looks only at ready jobs.
CREATE INDEX jobs_ready ON jobs (tenant, priority, created, id) WHERE status = 'accepted' AND not_before = 0;
CREATE INDEX jobs_delayed ON jobs (not_before) WHERE status = 'accepted' AND not_before > 0;
CREATE INDEX jobs_by_tenant ON jobs (tenant, id DESC);
CREATE INDEX jobs_by_status ON jobs (tenant, status, id DESC);
CREATE INDEX jobs_by_deadline ON jobs (deadline) WHERE deadline IS NOT NULL AND status IN ('accepted', 'running');

-- What was asked, compressed by the caller. Beside the job and not in it: a row is written whole, however little changes.
CREATE TABLE requests (
    job_id   TEXT COLLATE "C" PRIMARY KEY REFERENCES jobs (id) ON DELETE CASCADE,
    request  BYTEA NOT NULL
);
ALTER TABLE requests ALTER COLUMN request SET STORAGE EXTERNAL;

CREATE TABLE idempotency_keys (
    tenant   TEXT COLLATE "C" NOT NULL,
    key      TEXT COLLATE "C" NOT NULL,
    body     TEXT NOT NULL,
    job_id   TEXT COLLATE "C" NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    PRIMARY KEY (tenant, key)
);
-- For the deletion of a job.
CREATE INDEX idempotency_keys_by_job ON idempotency_keys (job_id);

-- What a running job's heartbeats write: as many narrow rows as there are busy workers. No index has a column that a
-- heartbeat changes, and pages have room, so that a heartbeat stays within its page (a HOT update).
-- A job is running if and only if it has a row here. Its revision is jobs.revision + beats.
CREATE TABLE leases (
    job_id       TEXT COLLATE "C" PRIMARY KEY REFERENCES jobs (id) ON DELETE CASCADE,
    tenant       TEXT COLLATE "C" NOT NULL,
    attempt      BIGINT NOT NULL,
    worker       TEXT NOT NULL,
    lease_until  BIGINT NOT NULL,
    beats        BIGINT NOT NULL DEFAULT 0,
    -- Of the last heartbeat.
    progress     TEXT,
    updated      BIGINT
) WITH (fillfactor = 50, autovacuum_vacuum_scale_factor = 0, autovacuum_vacuum_threshold = 500);

CREATE INDEX leases_by_tenant ON leases (tenant);

-- A job that stops running loses its lease in the same statement, and takes over what the lease counted.
CREATE FUNCTION end_lease() RETURNS trigger LANGUAGE plpgsql AS $$
DECLARE
    counted BIGINT;
BEGIN
    -- A statement of its own sees the lease of a claim that this update had to wait for.
    DELETE FROM leases WHERE job_id = old.id RETURNING beats INTO counted;
    new.revision := new.revision + COALESCE(counted, 0);
    RETURN new;
END $$;

CREATE TRIGGER leases_ended BEFORE UPDATE OF status ON jobs FOR EACH ROW
WHEN (old.status = 'running' AND new.status <> 'running') EXECUTE FUNCTION end_lease();

-- A row for every tenant and priority that may have ready jobs, with the time and the id of its oldest (its head): what a
-- claim looks through instead of the backlog. A submission finds its lane there and writes nothing; so those of one
-- tenant do not wait for each other. The head is a hint: a claim looks at the queue itself, and corrects the lane.
CREATE TABLE lanes (
    tenant    TEXT COLLATE "C" NOT NULL,
    priority  INTEGER NOT NULL,
    created   BIGINT NOT NULL,
    id        TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (tenant, priority)
) WITH (fillfactor = 50, autovacuum_vacuum_scale_factor = 0, autovacuum_vacuum_threshold = 500);

CREATE INDEX lanes_next ON lanes (priority DESC, created, id);

-- The keys of advisory locks. Of a tenant's turn: held by the claim that looks into its queues. Of its lanes: held shared by
-- transactions that make jobs ready, so that no lane is taken away under a job that nobody sees yet. Two tenants
-- with one key (it is a hash) would wait for each other now and then, and no more.
CREATE FUNCTION turn_key(tenant TEXT) RETURNS BIGINT LANGUAGE sql IMMUTABLE
RETURN hashtextextended(tenant COLLATE "C", 7301);
CREATE FUNCTION lanes_key(tenant TEXT) RETURNS BIGINT LANGUAGE sql IMMUTABLE
RETURN hashtextextended(tenant COLLATE "C", 7302);
CREATE FUNCTION quota_key(tenant TEXT) RETURNS BIGINT LANGUAGE sql IMMUTABLE
RETURN hashtextextended(tenant COLLATE "C", 7303);
CREATE FUNCTION place_key(tenant TEXT, name TEXT) RETURNS BIGINT LANGUAGE sql IMMUTABLE
RETURN hashtextextended((tenant || '/' || name) COLLATE "C", 7304);

CREATE FUNCTION join_lane() RETURNS trigger LANGUAGE plpgsql AS $$
DECLARE
    head BIGINT;
BEGIN
    PERFORM pg_advisory_xact_lock_shared(lanes_key(new.tenant));
    SELECT created INTO head FROM lanes
    WHERE tenant = new.tenant AND priority = new.priority AND (created, id) <= (new.created, new.id);
    IF NOT FOUND THEN
        INSERT INTO lanes (tenant, priority, created, id) VALUES (new.tenant, new.priority, new.created, new.id)
        ON CONFLICT (tenant, priority) DO UPDATE SET created = excluded.created, id = excluded.id
            WHERE (excluded.created, excluded.id) < (lanes.created, lanes.id);
    END IF;
    -- Transactions that notify commit one after the other. Where a job has waited for seconds nobody is idle, and nobody
    -- needs to be woken: so a backlog takes submissions as fast as the disk does.
    IF TG_OP = 'INSERT' AND (head IS NULL OR head > new.created - 2000) THEN
        PERFORM pg_notify('mapfit_jobs', '');
    END IF;
    RETURN NULL;
END $$;

CREATE TRIGGER lanes_submitted AFTER INSERT ON jobs FOR EACH ROW
WHEN (new.status = 'accepted' AND new.not_before = 0) EXECUTE FUNCTION join_lane();

CREATE TRIGGER lanes_joined AFTER UPDATE OF status, not_before ON jobs FOR EACH ROW
WHEN ((new.status = 'accepted' AND new.not_before = 0) AND NOT (old.status = 'accepted' AND old.not_before = 0))
EXECUTE FUNCTION join_lane();

-- Corrects a lane after its head was taken, or takes the lane away. Its turn is held by the caller, its row too.
CREATE FUNCTION advance_lane(of_tenant TEXT, of_priority INTEGER) RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    head RECORD;
BEGIN
    SELECT created, id INTO head FROM jobs
    WHERE status = 'accepted' AND not_before = 0 AND tenant = of_tenant AND priority = of_priority
    ORDER BY created, id LIMIT 1;
    IF NOT FOUND AND pg_try_advisory_xact_lock(lanes_key(of_tenant)) THEN
        -- Whoever was adding a job has committed, and a new statement sees it.
        SELECT created, id INTO head FROM jobs
        WHERE status = 'accepted' AND not_before = 0 AND tenant = of_tenant AND priority = of_priority
        ORDER BY created, id LIMIT 1;
        IF NOT FOUND THEN
            DELETE FROM lanes WHERE tenant = of_tenant AND priority = of_priority;
            RETURN;
        END IF;
    END IF;
    -- Where a job is being added its time is about now.
    UPDATE lanes SET created = COALESCE(head.created, now_ms()), id = COALESCE(head.id, id)
    WHERE tenant = of_tenant AND priority = of_priority;
END $$;

-- Makes retried jobs ready whose time has come; one transaction at a time does, as it may change many lanes.
CREATE FUNCTION make_due_ready(most INTEGER) RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    at CONSTANT BIGINT := now_ms();
BEGIN
    PERFORM 1 FROM jobs WHERE status = 'accepted' AND not_before > 0 AND not_before <= at LIMIT 1;
    IF FOUND AND pg_try_advisory_xact_lock(7300) THEN
        WITH due AS MATERIALIZED (
            SELECT id FROM jobs WHERE status = 'accepted' AND not_before > 0 AND not_before <= at
            ORDER BY not_before LIMIT most FOR UPDATE SKIP LOCKED
        )
        UPDATE jobs SET not_before = 0 FROM due WHERE jobs.id = due.id;
    END IF;
END $$;

-- Claims the next job: by priority, then by how few jobs of its tenant run, then by age.
--
-- Candidates are the first lanes of tenants that run nothing, and the lanes of those that run something, of whom there are at
-- most as many as workers. The first whose turn is free is looked at again under that lock; one whose state has changed
-- since is passed over, and looked for anew. No row: there is nothing to do. A row without a job: others hold the turns of
-- all who have something; `busy` is the first of them, to be waited for by calling again with it, which holds nothing yet.
CREATE FUNCTION claim_job(by_worker TEXT, lease_ms BIGINT, most_running BIGINT, wait_for TEXT)
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
                (SELECT tenant, priority, created, id, 0::bigint AS running FROM lanes
                 WHERE NOT EXISTS (SELECT 1 FROM leases WHERE leases.tenant = lanes.tenant)
                 ORDER BY priority DESC, created, id LIMIT 32)
                UNION ALL
                (SELECT lanes.tenant, lanes.priority, lanes.created, lanes.id, held.running
                 FROM (SELECT tenant, count(*) AS running FROM leases GROUP BY tenant) AS held
                 JOIN lanes ON lanes.tenant = held.tenant
                 WHERE held.running < most_running)
            ) AS candidate
            WHERE running < most_running
            ORDER BY priority DESC, running, created, id LIMIT 64
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

CREATE TABLE maps (
    id        TEXT COLLATE "C" PRIMARY KEY,
    job_id    TEXT COLLATE "C" NOT NULL UNIQUE REFERENCES jobs (id),
    tenant    TEXT COLLATE "C" NOT NULL,
    name      TEXT,
    labels    TEXT NOT NULL,
    created   BIGINT NOT NULL,
    distance  TEXT NOT NULL,
    lattice   TEXT NOT NULL,
    fit       TEXT NOT NULL,
    min_x     DOUBLE PRECISION NOT NULL,
    min_y     DOUBLE PRECISION NOT NULL,
    max_x     DOUBLE PRECISION NOT NULL,
    max_y     DOUBLE PRECISION NOT NULL,
    prefix    TEXT COLLATE "C" NOT NULL,
    -- Of the map's file.
    bytes     BIGINT NOT NULL DEFAULT 0,
    sha256    TEXT,
    parent    TEXT COLLATE "C",
    version   BIGINT NOT NULL DEFAULT 1
);

-- A list by bbox walks this index and reads only the rows of its page.
CREATE INDEX maps_by_tenant ON maps (tenant, id DESC, min_x, min_y, max_x, max_y);
-- For the sweep of artifacts.
CREATE INDEX maps_by_prefix ON maps (prefix);

-- The labels once more, as an index of the JSON in the rows. Kept by triggers.
CREATE TABLE job_labels (
    tenant  TEXT COLLATE "C" NOT NULL,
    key     TEXT COLLATE "C" NOT NULL,
    value   TEXT COLLATE "C" NOT NULL,
    job_id  TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (tenant, key, value, job_id)
);

CREATE TABLE map_labels (
    tenant  TEXT COLLATE "C" NOT NULL,
    key     TEXT COLLATE "C" NOT NULL,
    value   TEXT COLLATE "C" NOT NULL,
    map_id  TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (tenant, key, value, map_id)
);

CREATE FUNCTION label_job() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    IF TG_OP <> 'INSERT' AND old.labels <> '{}' THEN
        DELETE FROM job_labels AS kept USING json_each_text(old.labels::json) AS label
        WHERE kept.tenant = old.tenant AND kept.key = label.key AND kept.value = label.value AND kept.job_id = old.id;
    END IF;
    IF TG_OP <> 'DELETE' AND new.labels <> '{}' THEN
        INSERT INTO job_labels (tenant, key, value, job_id)
        SELECT new.tenant, label.key, label.value, new.id FROM json_each_text(new.labels::json) AS label
        ON CONFLICT DO NOTHING;
    END IF;
    RETURN NULL;
END $$;

CREATE TRIGGER job_labels_added AFTER INSERT ON jobs FOR EACH ROW
WHEN (new.labels <> '{}') EXECUTE FUNCTION label_job();
CREATE TRIGGER job_labels_replaced AFTER UPDATE OF labels ON jobs FOR EACH ROW
WHEN (new.labels <> old.labels) EXECUTE FUNCTION label_job();
CREATE TRIGGER job_labels_removed AFTER DELETE ON jobs FOR EACH ROW
WHEN (old.labels <> '{}') EXECUTE FUNCTION label_job();

CREATE FUNCTION label_map() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    IF TG_OP <> 'INSERT' AND old.labels <> '{}' THEN
        DELETE FROM map_labels AS kept USING json_each_text(old.labels::json) AS label
        WHERE kept.tenant = old.tenant AND kept.key = label.key AND kept.value = label.value AND kept.map_id = old.id;
    END IF;
    IF TG_OP <> 'DELETE' AND new.labels <> '{}' THEN
        INSERT INTO map_labels (tenant, key, value, map_id)
        SELECT new.tenant, label.key, label.value, new.id FROM json_each_text(new.labels::json) AS label
        ON CONFLICT DO NOTHING;
    END IF;
    RETURN NULL;
END $$;

CREATE TRIGGER map_labels_added AFTER INSERT ON maps FOR EACH ROW
WHEN (new.labels <> '{}') EXECUTE FUNCTION label_map();
CREATE TRIGGER map_labels_replaced AFTER UPDATE OF labels ON maps FOR EACH ROW
WHEN (new.labels <> old.labels) EXECUTE FUNCTION label_map();
CREATE TRIGGER map_labels_removed AFTER DELETE ON maps FOR EACH ROW
WHEN (old.labels <> '{}') EXECUTE FUNCTION label_map();

-- What a tenant has: jobs that wait, maps, bytes of maps. In several rows a tenant, of which the sum counts: a transaction
-- adds to one that nobody holds, and makes another where all are held. So counting makes nobody wait. A row by
-- itself says nothing, and may be below zero. Running jobs are counted in leases.
CREATE TABLE holdings (
    slot     BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    tenant   TEXT COLLATE "C" NOT NULL,
    queued   BIGINT NOT NULL,
    maps     BIGINT NOT NULL,
    bytes    BIGINT NOT NULL
) WITH (fillfactor = 50);

CREATE INDEX holdings_by_tenant ON holdings (tenant);

CREATE FUNCTION hold(of_tenant TEXT, more_queued BIGINT, more_maps BIGINT, more_bytes BIGINT)
RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    free BIGINT;
BEGIN
    SELECT slot INTO free FROM holdings WHERE tenant = of_tenant LIMIT 1 FOR UPDATE SKIP LOCKED;
    IF FOUND THEN
        UPDATE holdings SET queued = queued + more_queued, maps = maps + more_maps, bytes = bytes + more_bytes
        WHERE slot = free;
    ELSE
        INSERT INTO holdings (tenant, queued, maps, bytes) VALUES (of_tenant, more_queued, more_maps, more_bytes);
    END IF;
END $$;

CREATE FUNCTION hold_job() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    PERFORM hold(COALESCE(new.tenant, old.tenant),
                 CASE WHEN TG_OP <> 'DELETE' AND new.status = 'accepted' THEN 1 ELSE 0 END
                 - CASE WHEN TG_OP <> 'INSERT' AND old.status = 'accepted' THEN 1 ELSE 0 END, 0, 0);
    RETURN NULL;
END $$;

CREATE TRIGGER holdings_submitted AFTER INSERT ON jobs FOR EACH ROW
WHEN (new.status = 'accepted') EXECUTE FUNCTION hold_job();
CREATE TRIGGER holdings_moved AFTER UPDATE OF status ON jobs FOR EACH ROW
WHEN ((old.status = 'accepted') <> (new.status = 'accepted')) EXECUTE FUNCTION hold_job();
CREATE TRIGGER holdings_removed AFTER DELETE ON jobs FOR EACH ROW
WHEN (old.status = 'accepted') EXECUTE FUNCTION hold_job();

CREATE FUNCTION hold_map() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    IF TG_OP = 'INSERT' THEN
        PERFORM hold(new.tenant, 0, 1, new.bytes);
    ELSE
        PERFORM hold(old.tenant, 0, -1, -old.bytes);
    END IF;
    RETURN NULL;
END $$;

CREATE TRIGGER holdings_mapped AFTER INSERT OR DELETE ON maps FOR EACH ROW EXECUTE FUNCTION hold_map();

-- A place, and which of its versions is published.
CREATE TABLE places (
    tenant   TEXT COLLATE "C" NOT NULL,
    name     TEXT COLLATE "C" NOT NULL,
    version  BIGINT NOT NULL,
    PRIMARY KEY (tenant, name)
);

-- The serial grows with every publication of any place: what a robot that waits compares.
CREATE TABLE place_versions (
    serial     BIGINT GENERATED BY DEFAULT AS IDENTITY PRIMARY KEY,
    tenant     TEXT COLLATE "C" NOT NULL,
    name       TEXT COLLATE "C" NOT NULL,
    version    BIGINT NOT NULL,
    map_id     TEXT COLLATE "C" NOT NULL REFERENCES maps (id),
    note       TEXT,
    published  BIGINT NOT NULL,
    UNIQUE (tenant, name, version),
    FOREIGN KEY (tenant, name) REFERENCES places (tenant, name) ON DELETE CASCADE
);

CREATE INDEX place_versions_by_map ON place_versions (map_id);
CREATE INDEX place_versions_by_tenant ON place_versions (tenant, serial DESC);

-- API keys. The key itself is nowhere: what is kept is its SHA-256.
CREATE TABLE api_keys (
    id       TEXT COLLATE "C" PRIMARY KEY,
    tenant   TEXT COLLATE "C" NOT NULL,
    name     TEXT,
    scopes   TEXT NOT NULL,
    sha256   BYTEA NOT NULL,
    created  BIGINT NOT NULL,
    revoked  BIGINT
);

CREATE TABLE webhooks (
    id       TEXT COLLATE "C" PRIMARY KEY,
    tenant   TEXT COLLATE "C" NOT NULL,
    url      TEXT NOT NULL,
    events   TEXT NOT NULL,
    secret   TEXT NOT NULL,
    created  BIGINT NOT NULL
);

CREATE INDEX webhooks_by_tenant ON webhooks (tenant, id DESC);

-- What is told or to be told to whom. The payload stays as it was when the event happened.
CREATE TABLE deliveries (
    serial        BIGINT GENERATED BY DEFAULT AS IDENTITY PRIMARY KEY,
    id            TEXT COLLATE "C" NOT NULL UNIQUE,
    webhook_id    TEXT COLLATE "C" NOT NULL REFERENCES webhooks (id) ON DELETE CASCADE,
    event         TEXT NOT NULL,
    payload       TEXT NOT NULL,
    status        TEXT COLLATE "C" NOT NULL DEFAULT 'pending' CHECK (status IN ('pending', 'delivered', 'failed')),
    attempts      BIGINT NOT NULL DEFAULT 0,
    created       BIGINT NOT NULL,
    last_attempt  BIGINT,
    next_attempt  BIGINT,
    error         TEXT
);

CREATE INDEX deliveries_due ON deliveries (next_attempt) WHERE status = 'pending';
CREATE INDEX deliveries_by_webhook ON deliveries (webhook_id, serial DESC);

-- Queued in the transaction that makes the event: neither is there without the other. A webhook's row is held until then: one
-- that is being removed is waited for, and is gone.
CREATE FUNCTION queue_deliveries(of_tenant TEXT, event TEXT, data JSON) RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    at CONSTANT BIGINT := now_ms();
    hook RECORD;
    payload TEXT;
BEGIN
    FOR hook IN SELECT id FROM webhooks WHERE tenant = of_tenant AND events::jsonb ? event ORDER BY id FOR KEY SHARE LOOP
        payload := json_build_object(
            'type', event,
            'timestamp', to_char(to_timestamp(at / 1000.0) AT TIME ZONE 'UTC', 'YYYY-MM-DD"T"HH24:MI:SS.MS"Z"'),
            'data', data);
        INSERT INTO deliveries (id, webhook_id, event, payload, created, next_attempt)
        VALUES ('msg_' || replace(gen_random_uuid()::text, '-', ''), hook.id, event, payload, at, at);
    END LOOP;
END $$;

CREATE FUNCTION tell_of_job() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    PERFORM queue_deliveries(new.tenant, 'job.' || new.status,
        json_build_object('id', new.id, 'name', new.name, 'labels', new.labels::json, 'status', new.status,
                          'map_id', new.map_id, 'problem', new.problem::json));
    RETURN NULL;
END $$;

CREATE TRIGGER deliveries_of_jobs AFTER UPDATE OF status ON jobs FOR EACH ROW
WHEN (old.status <> new.status AND new.status IN ('successful', 'failed', 'dismissed')) EXECUTE FUNCTION tell_of_job();

CREATE FUNCTION tell_of_place() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    PERFORM queue_deliveries(new.tenant, 'place.published',
        json_build_object('name', new.name, 'version', new.version, 'map_id', new.map_id, 'note', new.note));
    RETURN NULL;
END $$;

CREATE TRIGGER deliveries_of_places AFTER INSERT ON place_versions FOR EACH ROW EXECUTE FUNCTION tell_of_place();

-- One row, written anew by every probe of readiness: a database that cannot commit takes no work.
CREATE TABLE probes (
    id       INTEGER PRIMARY KEY CHECK (id = 1),
    written  BIGINT NOT NULL
) WITH (fillfactor = 50);
