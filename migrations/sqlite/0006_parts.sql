-- Branches of a fit's elimination that other workers may take. A row is there while its part is on offer; it is free while its
-- lease lies in the past.

CREATE TABLE parts (
    prefix TEXT NOT NULL,
    number INTEGER NOT NULL,
    job_id TEXT NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    attempt INTEGER NOT NULL,
    claim INTEGER NOT NULL DEFAULT 0,
    worker TEXT,
    lease_until INTEGER NOT NULL DEFAULT 0,
    sent INTEGER NOT NULL DEFAULT 0,
    delivered INTEGER NOT NULL DEFAULT 0,
    PRIMARY KEY (prefix, number)
) WITHOUT ROWID;

CREATE INDEX parts_by_job ON parts (job_id);
CREATE INDEX parts_open ON parts (prefix, number) WHERE delivered = 0;
