-- What a fleet needs beside jobs and maps: places, keys, webhooks, and counts by tenant.

ALTER TABLE jobs ADD COLUMN retry_of TEXT;
-- Milliseconds since 1970; past it the job has failed.
ALTER TABLE jobs ADD COLUMN deadline INTEGER;
CREATE INDEX jobs_by_deadline ON jobs (deadline) WHERE deadline IS NOT NULL AND status IN ('accepted', 'running');

-- Of the map's file; not known of maps from before.
ALTER TABLE maps ADD COLUMN bytes INTEGER NOT NULL DEFAULT 0;
ALTER TABLE maps ADD COLUMN sha256 TEXT;
ALTER TABLE maps ADD COLUMN parent TEXT;
ALTER TABLE maps ADD COLUMN version INTEGER NOT NULL DEFAULT 1;

-- Labels may be replaced.
CREATE TRIGGER job_labels_replaced AFTER UPDATE OF labels ON jobs WHEN new.labels <> old.labels
BEGIN
    DELETE FROM job_labels WHERE (tenant, key, value, job_id) IN
        (SELECT old.tenant, label.key, label.value, old.id FROM json_each(old.labels) AS label);
    INSERT OR IGNORE INTO job_labels (tenant, key, value, job_id)
    SELECT new.tenant, label.key, label.value, new.id FROM json_each(new.labels) AS label;
END;

CREATE TRIGGER map_labels_replaced AFTER UPDATE OF labels ON maps WHEN new.labels <> old.labels
BEGIN
    DELETE FROM map_labels WHERE (tenant, key, value, map_id) IN
        (SELECT old.tenant, label.key, label.value, old.id FROM json_each(old.labels) AS label);
    INSERT OR IGNORE INTO map_labels (tenant, key, value, map_id)
    SELECT new.tenant, label.key, label.value, new.id FROM json_each(new.labels) AS label;
END;

-- What a tenant has now. Kept by the triggers below, so that a quota costs one row.
CREATE TABLE holdings (
    tenant   TEXT PRIMARY KEY,
    queued   INTEGER NOT NULL DEFAULT 0,
    running  INTEGER NOT NULL DEFAULT 0,
    maps     INTEGER NOT NULL DEFAULT 0,
    bytes    INTEGER NOT NULL DEFAULT 0
) STRICT, WITHOUT ROWID;

INSERT INTO holdings (tenant, queued, running)
SELECT tenant, sum(status = 'accepted'), sum(status = 'running') FROM jobs GROUP BY tenant;
INSERT INTO holdings (tenant, maps) SELECT tenant, count(*) FROM maps WHERE true GROUP BY tenant
ON CONFLICT (tenant) DO UPDATE SET maps = excluded.maps;

CREATE TRIGGER holdings_submitted AFTER INSERT ON jobs
BEGIN
    INSERT INTO holdings (tenant, queued, running)
    VALUES (new.tenant, new.status = 'accepted', new.status = 'running')
    ON CONFLICT (tenant) DO UPDATE SET queued = queued + excluded.queued, running = running + excluded.running;
END;

CREATE TRIGGER holdings_moved AFTER UPDATE OF status ON jobs WHEN old.status <> new.status
BEGIN
    UPDATE holdings SET queued = queued + (new.status = 'accepted') - (old.status = 'accepted'),
                        running = running + (new.status = 'running') - (old.status = 'running')
    WHERE tenant = new.tenant;
END;

CREATE TRIGGER holdings_removed AFTER DELETE ON jobs WHEN old.status IN ('accepted', 'running')
BEGIN
    UPDATE holdings SET queued = queued - (old.status = 'accepted'), running = running - (old.status = 'running')
    WHERE tenant = old.tenant;
END;

CREATE TRIGGER holdings_mapped AFTER INSERT ON maps
BEGIN
    INSERT INTO holdings (tenant, maps, bytes) VALUES (new.tenant, 1, new.bytes)
    ON CONFLICT (tenant) DO UPDATE SET maps = maps + 1, bytes = bytes + excluded.bytes;
END;

CREATE TRIGGER holdings_unmapped AFTER DELETE ON maps
BEGIN
    UPDATE holdings SET maps = maps - 1, bytes = bytes - old.bytes WHERE tenant = old.tenant;
END;

-- A place, and which of its versions is published.
CREATE TABLE places (
    tenant   TEXT NOT NULL,
    name     TEXT NOT NULL,
    version  INTEGER NOT NULL,
    PRIMARY KEY (tenant, name)
) STRICT, WITHOUT ROWID;

-- The serial grows with every publication of any place: what a robot that waits compares.
CREATE TABLE place_versions (
    serial     INTEGER PRIMARY KEY AUTOINCREMENT,
    tenant     TEXT NOT NULL,
    name       TEXT NOT NULL,
    version    INTEGER NOT NULL,
    map_id     TEXT NOT NULL REFERENCES maps (id),
    note       TEXT,
    published  INTEGER NOT NULL,
    UNIQUE (tenant, name, version),
    FOREIGN KEY (tenant, name) REFERENCES places (tenant, name) ON DELETE CASCADE
) STRICT;

CREATE INDEX place_versions_by_map ON place_versions (map_id);

-- API keys. The key itself is nowhere: what is kept is its SHA-256.
CREATE TABLE api_keys (
    id       TEXT PRIMARY KEY,
    tenant   TEXT NOT NULL,
    name     TEXT,
    scopes   TEXT NOT NULL,
    sha256   BLOB NOT NULL,
    created  INTEGER NOT NULL,
    revoked  INTEGER
) STRICT, WITHOUT ROWID;

CREATE TABLE webhooks (
    id       TEXT PRIMARY KEY,
    tenant   TEXT NOT NULL,
    url      TEXT NOT NULL,
    events   TEXT NOT NULL,
    secret   TEXT NOT NULL,
    created  INTEGER NOT NULL
) STRICT;

CREATE INDEX webhooks_by_tenant ON webhooks (tenant, id DESC);

-- What is told or to be told to whom. The payload stays as it was when the event happened.
CREATE TABLE deliveries (
    serial        INTEGER PRIMARY KEY AUTOINCREMENT,
    id            TEXT NOT NULL UNIQUE,
    webhook_id    TEXT NOT NULL REFERENCES webhooks (id) ON DELETE CASCADE,
    event         TEXT NOT NULL,
    payload       TEXT NOT NULL,
    status        TEXT NOT NULL DEFAULT 'pending' CHECK (status IN ('pending', 'delivered', 'failed')),
    attempts      INTEGER NOT NULL DEFAULT 0,
    created       INTEGER NOT NULL,
    last_attempt  INTEGER,
    next_attempt  INTEGER,
    error         TEXT
) STRICT;

CREATE INDEX deliveries_due ON deliveries (next_attempt) WHERE status = 'pending';
CREATE INDEX deliveries_by_webhook ON deliveries (webhook_id, serial DESC);

-- Queued in the transaction that makes the event: neither is there without the other.
CREATE TRIGGER deliveries_of_jobs AFTER UPDATE OF status ON jobs
WHEN old.status <> new.status AND new.status IN ('successful', 'failed', 'dismissed')
BEGIN
    INSERT INTO deliveries (id, webhook_id, event, payload, created, next_attempt)
    SELECT 'msg_' || lower(hex(randomblob(16))), hook.id, 'job.' || new.status,
           json_object('type', 'job.' || new.status, 'timestamp', strftime('%Y-%m-%dT%H:%M:%fZ', 'now'),
                       'data', json_object('id', new.id, 'name', new.name, 'labels', json(new.labels),
                                           'status', new.status, 'map_id', new.map_id, 'problem', json(new.problem))),
           CAST(unixepoch('subsec') * 1000 AS INTEGER), CAST(unixepoch('subsec') * 1000 AS INTEGER)
    FROM webhooks AS hook
    WHERE hook.tenant = new.tenant
      AND EXISTS (SELECT 1 FROM json_each(hook.events) AS event WHERE event.value = 'job.' || new.status);
END;

CREATE TRIGGER deliveries_of_places AFTER INSERT ON place_versions
BEGIN
    INSERT INTO deliveries (id, webhook_id, event, payload, created, next_attempt)
    SELECT 'msg_' || lower(hex(randomblob(16))), hook.id, 'place.published',
           json_object('type', 'place.published', 'timestamp', strftime('%Y-%m-%dT%H:%M:%fZ', 'now'),
                       'data', json_object('name', new.name, 'version', new.version, 'map_id', new.map_id,
                                           'note', new.note)),
           CAST(unixepoch('subsec') * 1000 AS INTEGER), CAST(unixepoch('subsec') * 1000 AS INTEGER)
    FROM webhooks AS hook
    WHERE hook.tenant = new.tenant
      AND EXISTS (SELECT 1 FROM json_each(hook.events) AS event WHERE event.value = 'place.published');
END;
