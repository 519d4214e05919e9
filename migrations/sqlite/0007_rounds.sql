-- Among tenants with as few jobs running, whoever was served longest ago is next: a tenant that fills the queue keeps nobody
-- out who comes later, even where one worker claims, or where more tenants wait than there are workers.

-- Which of all claims was a tenant's last. It stays when the tenant's queues are empty: whoever submits one job after another
-- is no newcomer each time.
CREATE TABLE served (
    tenant  TEXT PRIMARY KEY,
    claim   INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

CREATE INDEX served_by_claim ON served (claim);

ALTER TABLE turns ADD COLUMN served INTEGER NOT NULL DEFAULT 0;
DROP INDEX turns_next;
CREATE INDEX turns_next ON turns (priority DESC, running, served, created, id);

-- A queue that begins anew, whoever begins it.
CREATE TRIGGER turns_remembered AFTER INSERT ON turns
BEGIN
    UPDATE turns SET served = COALESCE((SELECT claim FROM served WHERE tenant = new.tenant), 0)
    WHERE tenant = new.tenant AND priority = new.priority;
END;

CREATE TRIGGER turns_served AFTER UPDATE OF status ON jobs
WHEN new.status = 'running' AND old.status <> 'running'
BEGIN
    INSERT INTO served (tenant, claim) VALUES (new.tenant, (SELECT COALESCE(max(claim), 0) + 1 FROM served))
    ON CONFLICT (tenant) DO UPDATE SET claim = excluded.claim;
    UPDATE turns SET served = (SELECT claim FROM served WHERE tenant = new.tenant) WHERE tenant = new.tenant;
END;

-- A job that is given back is as if it had never been claimed, and so is its tenant.
CREATE TRIGGER turns_released AFTER UPDATE OF status ON jobs
WHEN old.status = 'running' AND new.status = 'accepted' AND new.attempt < old.attempt
BEGIN
    UPDATE served SET claim = 0 WHERE tenant = new.tenant;
    UPDATE turns SET served = 0 WHERE tenant = new.tenant;
END;
