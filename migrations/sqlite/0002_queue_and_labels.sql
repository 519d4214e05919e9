-- The queue answers "whose turn is it" by one seek, lists by label and by status are walks of an index, and the request
-- leaves the job's row, which every heartbeat writes.

-- What was asked, compressed. Beside the job and not in it: a row is written whole, however little of it changes.
CREATE TABLE requests (
    job_id   TEXT PRIMARY KEY REFERENCES jobs (id) ON DELETE CASCADE,
    request  BLOB NOT NULL
) STRICT;

INSERT INTO requests (job_id, request) SELECT id, request FROM jobs ORDER BY id;
ALTER TABLE jobs DROP COLUMN request;

-- A job is ready when it is accepted and not_before is 0. A retried job waits with its time in not_before; a claim
-- first sets those that are due to 0, and then looks only at ready jobs.
DROP INDEX jobs_waiting;
CREATE INDEX jobs_ready ON jobs (tenant, priority, created, id) WHERE status = 'accepted' AND not_before = 0;
CREATE INDEX jobs_delayed ON jobs (not_before) WHERE status = 'accepted' AND not_before > 0;
-- Without lease_until, so that a heartbeat writes no index; there are as many rows as workers.
CREATE INDEX jobs_running ON jobs (tenant) WHERE status = 'running';
CREATE INDEX jobs_by_status ON jobs (tenant, status, id DESC);
-- For the deletion of a job.
CREATE INDEX idempotency_keys_by_job ON idempotency_keys (job_id);

-- The head of each queue: the oldest ready job of a tenant at a priority, and how many jobs of the tenant run. The
-- first row of turns_next is the job to claim. Kept by the triggers below; nothing else writes it.
CREATE TABLE turns (
    tenant    TEXT NOT NULL,
    priority  INTEGER NOT NULL,
    running   INTEGER NOT NULL,
    created   INTEGER NOT NULL,
    id        TEXT NOT NULL,
    PRIMARY KEY (tenant, priority)
) STRICT, WITHOUT ROWID;

CREATE INDEX turns_next ON turns (priority DESC, running, created, id);

INSERT INTO turns (tenant, priority, running, created, id)
SELECT tenant, priority, (SELECT count(*) FROM jobs AS busy WHERE busy.status = 'running' AND busy.tenant = ready.tenant),
       created, id
FROM (SELECT tenant, priority, created, id,
             row_number() OVER (PARTITION BY tenant, priority ORDER BY created, id) AS place
      FROM jobs WHERE status = 'accepted' AND not_before = 0) AS ready
WHERE place = 1;

CREATE TRIGGER turns_submitted AFTER INSERT ON jobs
WHEN new.status = 'accepted' AND new.not_before = 0
BEGIN
    INSERT INTO turns (tenant, priority, running, created, id)
    VALUES (new.tenant, new.priority,
            (SELECT count(*) FROM jobs WHERE status = 'running' AND tenant = new.tenant), new.created, new.id)
    ON CONFLICT (tenant, priority) DO UPDATE SET created = excluded.created, id = excluded.id
        WHERE (excluded.created, excluded.id) < (turns.created, turns.id);
END;

CREATE TRIGGER turns_joined AFTER UPDATE OF status, not_before ON jobs
WHEN (new.status = 'accepted' AND new.not_before = 0) AND NOT (old.status = 'accepted' AND old.not_before = 0)
BEGIN
    INSERT INTO turns (tenant, priority, running, created, id)
    VALUES (new.tenant, new.priority,
            (SELECT count(*) FROM jobs WHERE status = 'running' AND tenant = new.tenant), new.created, new.id)
    ON CONFLICT (tenant, priority) DO UPDATE SET created = excluded.created, id = excluded.id
        WHERE (excluded.created, excluded.id) < (turns.created, turns.id);
END;

CREATE TRIGGER turns_left AFTER UPDATE OF status, not_before ON jobs
WHEN (old.status = 'accepted' AND old.not_before = 0) AND NOT (new.status = 'accepted' AND new.not_before = 0)
BEGIN
    DELETE FROM turns WHERE tenant = old.tenant AND priority = old.priority AND id = old.id;
    INSERT OR IGNORE INTO turns (tenant, priority, running, created, id)
    SELECT tenant, priority, (SELECT count(*) FROM jobs WHERE status = 'running' AND tenant = old.tenant), created, id
    FROM jobs
    WHERE status = 'accepted' AND not_before = 0 AND tenant = old.tenant AND priority = old.priority
    ORDER BY created, id LIMIT 1;
END;

CREATE TRIGGER turns_deleted AFTER DELETE ON jobs
WHEN old.status = 'accepted' AND old.not_before = 0
BEGIN
    DELETE FROM turns WHERE tenant = old.tenant AND priority = old.priority AND id = old.id;
    INSERT OR IGNORE INTO turns (tenant, priority, running, created, id)
    SELECT tenant, priority, (SELECT count(*) FROM jobs WHERE status = 'running' AND tenant = old.tenant), created, id
    FROM jobs
    WHERE status = 'accepted' AND not_before = 0 AND tenant = old.tenant AND priority = old.priority
    ORDER BY created, id LIMIT 1;
END;

CREATE TRIGGER turns_counted AFTER UPDATE OF status ON jobs
WHEN (old.status = 'running') <> (new.status = 'running')
BEGIN
    UPDATE turns SET running = (SELECT count(*) FROM jobs WHERE status = 'running' AND tenant = new.tenant)
    WHERE tenant = new.tenant;
END;

-- The labels once more, as an index of the JSON in the rows. Kept by triggers; labels do not change after submission.
CREATE TABLE job_labels (
    tenant  TEXT NOT NULL,
    key     TEXT NOT NULL,
    value   TEXT NOT NULL,
    job_id  TEXT NOT NULL,
    PRIMARY KEY (tenant, key, value, job_id)
) STRICT, WITHOUT ROWID;

INSERT OR IGNORE INTO job_labels (tenant, key, value, job_id)
SELECT jobs.tenant, label.key, label.value, jobs.id FROM jobs, json_each(jobs.labels) AS label ORDER BY 1, 2, 3, 4;

CREATE TRIGGER job_labels_added AFTER INSERT ON jobs WHEN new.labels <> '{}'
BEGIN
    INSERT OR IGNORE INTO job_labels (tenant, key, value, job_id)
    SELECT new.tenant, label.key, label.value, new.id FROM json_each(new.labels) AS label;
END;

CREATE TRIGGER job_labels_removed AFTER DELETE ON jobs WHEN old.labels <> '{}'
BEGIN
    DELETE FROM job_labels WHERE (tenant, key, value, job_id) IN
        (SELECT old.tenant, label.key, label.value, old.id FROM json_each(old.labels) AS label);
END;

CREATE TABLE map_labels (
    tenant  TEXT NOT NULL,
    key     TEXT NOT NULL,
    value   TEXT NOT NULL,
    map_id  TEXT NOT NULL,
    PRIMARY KEY (tenant, key, value, map_id)
) STRICT, WITHOUT ROWID;

INSERT OR IGNORE INTO map_labels (tenant, key, value, map_id)
SELECT maps.tenant, label.key, label.value, maps.id FROM maps, json_each(maps.labels) AS label ORDER BY 1, 2, 3, 4;

CREATE TRIGGER map_labels_added AFTER INSERT ON maps WHEN new.labels <> '{}'
BEGIN
    INSERT OR IGNORE INTO map_labels (tenant, key, value, map_id)
    SELECT new.tenant, label.key, label.value, new.id FROM json_each(new.labels) AS label;
END;

CREATE TRIGGER map_labels_removed AFTER DELETE ON maps WHEN old.labels <> '{}'
BEGIN
    DELETE FROM map_labels WHERE (tenant, key, value, map_id) IN
        (SELECT old.tenant, label.key, label.value, old.id FROM json_each(old.labels) AS label);
END;

-- A list by bbox walks this index and reads only the rows of its page.
DROP INDEX maps_by_tenant;
CREATE INDEX maps_by_tenant ON maps (tenant, id DESC, min_x, min_y, max_x, max_y);

-- One row, written anew by every probe of readiness: a database that cannot commit takes no work.
CREATE TABLE probes (
    id       INTEGER PRIMARY KEY CHECK (id = 1),
    written  INTEGER NOT NULL
) STRICT;
