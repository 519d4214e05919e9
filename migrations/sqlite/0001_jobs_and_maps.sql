-- Jobs, the maps they ended in, and the keys that make a submission idempotent.
-- Times are milliseconds since 1970 by the database's clock.
CREATE TABLE jobs (
    id             TEXT PRIMARY KEY,
    tenant         TEXT NOT NULL,
    name           TEXT,
    labels         TEXT NOT NULL,
    status         TEXT NOT NULL CHECK (status IN ('accepted', 'running', 'successful', 'failed', 'dismissed')),
    progress       TEXT NOT NULL,
    message        TEXT,
    problem        TEXT,
    created        INTEGER NOT NULL,
    started        INTEGER,
    finished       INTEGER,
    updated        INTEGER NOT NULL,
    attempt        INTEGER NOT NULL DEFAULT 0,
    priority       INTEGER NOT NULL DEFAULT 0,
    map_id         TEXT,
    revision       INTEGER NOT NULL DEFAULT 1,
    worker         TEXT,
    lease_until    INTEGER,
    not_before     INTEGER NOT NULL DEFAULT 0,
    request        BLOB NOT NULL
) STRICT;

CREATE INDEX jobs_waiting ON jobs (status, priority DESC, created);
CREATE INDEX jobs_by_tenant ON jobs (tenant, id DESC);

CREATE TABLE idempotency_keys (
    tenant   TEXT NOT NULL,
    key      TEXT NOT NULL,
    body     TEXT NOT NULL,
    job_id   TEXT NOT NULL REFERENCES jobs (id),
    PRIMARY KEY (tenant, key)
) STRICT, WITHOUT ROWID;

CREATE TABLE maps (
    id         TEXT PRIMARY KEY,
    job_id     TEXT NOT NULL UNIQUE REFERENCES jobs (id),
    tenant     TEXT NOT NULL,
    name       TEXT,
    labels     TEXT NOT NULL,
    created    INTEGER NOT NULL,
    distance   TEXT NOT NULL,
    lattice    TEXT NOT NULL,
    fit        TEXT NOT NULL,
    min_x      REAL NOT NULL,
    min_y      REAL NOT NULL,
    max_x      REAL NOT NULL,
    max_y      REAL NOT NULL,
    prefix     TEXT NOT NULL
) STRICT;

CREATE INDEX maps_by_tenant ON maps (tenant, id DESC);
