"""Distance maps with their covariance from laser scans: a client for the mapfit service.

    client = Client()
    map = client.submit("job.json").wait()
    map.evaluate([[1.9, 0.1]]).distance

`Client` waits in place, `AsyncClient` is awaited. A `Map` evaluates here, without the service, what the service would
answer.
"""

from .async_client import AsyncClient
from .async_jobs import AsyncJob
from .async_maps import AsyncMap
from .client import Client
from .errors import JobFailed, MapfitError, NotDownloaded, NotReachable
from .evaluation import Evaluation
from .jobs import Job
from .localization import LocalizedPose
from .maps import Map
from .occupancy import OccupancyGrid
from .places import AsyncPlace, Place
from .recordings.jobs import log_to_job
from .version import VERSION as __version__

__all__ = [
    "AsyncClient",
    "AsyncJob",
    "AsyncMap",
    "AsyncPlace",
    "Client",
    "Evaluation",
    "Job",
    "JobFailed",
    "LocalizedPose",
    "Map",
    "MapfitError",
    "NotDownloaded",
    "NotReachable",
    "OccupancyGrid",
    "Place",
    "__version__",
    "log_to_job",
]
