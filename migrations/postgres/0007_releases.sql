-- A job that is given back was never served (0006). Fires behind lanes_joined, by their names: `served` is what is locked last.
CREATE TRIGGER lanes_released AFTER UPDATE OF status ON jobs FOR EACH ROW
WHEN (old.status = 'running' AND new.status = 'accepted' AND new.attempt < old.attempt) EXECUTE FUNCTION unserve();
