-- Branches of a fit's elimination that other workers may take. A row is there while its part is on offer; it is free while its
-- lease lies in the past.

CREATE TABLE parts (
    prefix TEXT NOT NULL,
    number BIGINT NOT NULL,
    job_id TEXT NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    attempt BIGINT NOT NULL,
    claim BIGINT NOT NULL DEFAULT 0,
    worker TEXT,
    lease_until BIGINT NOT NULL DEFAULT 0,
    sent BOOLEAN NOT NULL DEFAULT false,
    delivered BOOLEAN NOT NULL DEFAULT false,
    PRIMARY KEY (prefix, number)
);

CREATE INDEX parts_by_job ON parts (job_id);
CREATE INDEX parts_open ON parts (prefix, number) WHERE NOT delivered;
