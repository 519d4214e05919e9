"""What is known of a submitted job, however it is followed."""

from .records import ENDED, JobRecord, JobStatus, Problem, problem_of


class SubmittedJob:
    """A job's record, as it was last heard of."""

    def __init__(self, record: JobRecord) -> None:
        self.record = record

    def __repr__(self) -> str:
        named = f" {self.name!r}" if self.name else ""
        return f"<{type(self).__name__} {self.id}{named}: {self.status}>"

    @property
    def id(self) -> str:
        """The job's id."""
        return self.record["id"]

    @property
    def name(self) -> str | None:
        """Its name."""
        return self.record["name"]

    @property
    def labels(self) -> dict[str, str]:
        """Its labels."""
        return self.record["labels"]

    @property
    def status(self) -> JobStatus:
        """Where it stands."""
        return self.record["status"]

    @property
    def ended(self) -> bool:
        """Whether nothing more will happen to it."""
        return self.status in ENDED

    @property
    def map_id(self) -> str | None:
        """Its map's id, once successful."""
        return self.record["map_id"]

    @property
    def problem(self) -> Problem | None:
        """Why it failed, once failed."""
        return problem_of(self.record)
