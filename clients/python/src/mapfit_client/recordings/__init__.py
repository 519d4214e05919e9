"""Files and documents into jobs."""
