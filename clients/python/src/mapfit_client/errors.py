"""What goes wrong, each with the RFC 9457 problem that says why."""

from .records import JobRecord, Problem, problem_of


class MapfitError(Exception):
    """The service refused, failed, or could not be reached; `problem` says why."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        super().__init__(said(problem))


class NotReachable(MapfitError):
    """No answer came; the problem's status is 0."""


class NotDownloaded(MapfitError):
    """The map's arrays are needed here, and are not here."""


class JobFailed(MapfitError):
    """The job ended without a map."""

    def __init__(self, job: JobRecord) -> None:
        self.job = job
        super().__init__(problem_of(job) or _without_problem(job))


def said(problem: Problem) -> str:
    """A problem in a line, with every fault below it."""
    faults = [
        f"\n  {fault.get('pointer') or fault.get('parameter') or 'the body'}: {fault['detail']}"
        for fault in problem.get("errors", [])
    ]
    status = f" ({problem['status']})" if problem["status"] else ""
    return f"{problem['title']}{status}: {problem['detail']}" + "".join(faults)


def _without_problem(job: JobRecord) -> Problem:
    return {
        "type": f"/problems/job-{job['status']}",
        "title": f"The job is {job['status']}",
        "status": 0,
        "detail": job["message"] or f"job {job['id']} has no map",
    }
