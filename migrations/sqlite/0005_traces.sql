-- The W3C Trace Context of a job's submission: every attempt is a span under it, in whichever process.
ALTER TABLE jobs ADD COLUMN traceparent TEXT;
