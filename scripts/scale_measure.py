"""What jobs and requests cost on this machine: docs/scale/costs.json and services.csv.

Arguments: the mapfit program, the folder of real logs, where to write. Costs are a process's CPU seconds (/proc/PID/stat), which
others on the machine change little; waits and rates are wall time, and the load average is written down beside them.
"""

import gzip
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

PROGRAM, LOGS, OUT = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
TICK = os.sysconf("SC_CLK_TCK")
# A robot's job: so many scans of a log, one after another.
WINDOW = 60
LOGS_USED = ["intel", "freiburg-079", "seattle"]
WINDOWS = 8


class Service:
    """A process of the program, and what it has used."""

    def __init__(self, *arguments, command="serve"):
        self.data = tempfile.mkdtemp(prefix="mapfit-scale-")
        self.start(command, *arguments)

    def start(self, command, *arguments):
        line = [PROGRAM, command, "--log", "error", "--data", self.data, *arguments]
        if command == "serve":
            line += ["--listen", "127.0.0.1:0"]
        self.process = subprocess.Popen(line, stdout=subprocess.PIPE, text=True)
        if command == "serve":
            self.url = self.process.stdout.readline().split()[-1]

    def cpu(self):
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / TICK

    def memory(self):
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(status.split("VmHWM:")[1].split()[0]) * 1024

    def ask(self, method, path, body=None, **headers):
        data = json.dumps(body).encode() if isinstance(body, dict) else body
        if data is not None:
            headers.setdefault("content_type", "application/json")
        headers = {name.replace("_", "-"): value for name, value in headers.items()}
        request = urllib.request.Request(self.url + path, data=data, method=method, headers=headers)
        try:
            with urllib.request.urlopen(request, timeout=120) as answer:
                return answer.status, answer.read()
        except urllib.error.HTTPError as error:
            return error.code, error.read()

    def job(self, id):
        while True:
            job = json.loads(self.ask("GET", f"/v1/jobs/{id}?wait=60")[1])
            if job["status"] in ("successful", "failed", "dismissed"):
                assert job["status"] == "successful", job
                return job

    def stop(self):
        self.process.terminate()
        self.process.wait()


def bodies():
    """Jobs of real logs: by log, windows of scans spread over it, as the client sends them."""
    service = Service("--workers", "0")
    for name in LOGS_USED:
        log = LOGS / f"{name}.flaser.log.gz"
        with gzip.open(log, "rt", errors="replace") as lines:
            scans = sum(line.startswith("FLASER") for line in lines)
        for k in range(WINDOWS):
            first = k * max(scans - WINDOW, 0) // max(WINDOWS - 1, 1)
            window = ["--from", str(first), "--to", str(first + WINDOW), "--name", f"{name} {first}"]
            subprocess.run([PROGRAM, "submit", "--log", "error", "--url", service.url, *window, str(log)], check=True, stdout=subprocess.DEVNULL)
    items = json.loads(service.ask("GET", "/v1/jobs?limit=1000")[1])["items"]
    made = [(job["name"], service.ask("GET", f"/v1/jobs/{job['id']}/request")[1]) for job in items]
    service.stop()
    return sorted(made)


def cost_of(service, times, ask):
    """CPU milliseconds and the median of wall milliseconds a request."""
    ask(0)
    before, took = service.cpu(), []
    for k in range(times):
        began = time.perf_counter()
        status, _ = ask(k)
        took.append(1e3 * (time.perf_counter() - began))
        assert status in (200, 202, 304), status
    return {"cpu_ms": 1e3 * (service.cpu() - before) / times, "wall_ms": statistics.median(took)}


def jobs_alone(jobs):
    """Jobs one after another on one worker: what each costs, and a map to ask."""
    service = Service("--workers", "1")
    found = []
    for name, body in jobs:
        before = service.cpu()
        job = service.job(json.loads(service.ask("POST", "/v1/jobs", body)[1])["id"])
        cpu = service.cpu() - before
        map = json.loads(service.ask("GET", f"/v1/maps/{job['map_id']}")[1])
        found.append({
            "name": name, "cpu": cpu, "fit_seconds": map["fit"]["seconds"], "body_bytes": len(body),
            "control_points": map["fit"].get("active_control_points") or map["lattice"]["control_points"][0] * map["lattice"]["control_points"][1],
            "map_id": job["map_id"],
        })
    return service, found


def requests(service, jobs, found):
    map = found[0]["map_id"]
    points = {"points": [[0.02 * k, 1.0] for k in range(500)]}
    name = "hall"
    assert service.ask("PUT", f"/v1/places/{name}", {"map_id": map})[0] in (200, 201)
    with urllib.request.urlopen(f"{service.url}/v1/places/{name}") as answer:
        tag = answer.headers["etag"]
    id = json.loads(service.ask("GET", "/v1/jobs?limit=1")[1])["items"][0]["id"]
    scan = json.loads(jobs[0][1])
    located = {"scans": scan["scans"][:1], "noise": scan["noise"]}
    return {
        "GET /v1/jobs/{id}": cost_of(service, 500, lambda k: service.ask("GET", f"/v1/jobs/{id}")),
        "GET /v1/places/{name}, unchanged": cost_of(service, 500, lambda k: service.ask("GET", f"/v1/places/{name}", if_none_match=tag)),
        "GET /v1/jobs, a page of 50": cost_of(service, 200, lambda k: service.ask("GET", "/v1/jobs?limit=50")),
        "POST query, 500 points": cost_of(service, 100, lambda k: service.ask("POST", f"/v1/maps/{map}/query", points)),
        "GET ogm (0.1 m, PNG)": cost_of(service, 20, lambda k: service.ask("GET", f"/v1/maps/{map}/ogm?resolution=0.1", accept="image/png")),
        "GET coefficients (npz)": cost_of(service, 50, lambda k: service.ask("GET", f"/v1/maps/{map}/coefficients", accept="application/x-npz")),
        "POST localize, one scan": cost_of(service, 20, lambda k: service.ask("POST", f"/v1/maps/{map}/localize", located)),
    }


def submissions(jobs, *stores):
    """What a submission costs, and how many a second eight clients get accepted."""
    service = Service("--workers", "0", *stores)
    body = jobs[0][1]
    one = cost_of(service, 60, lambda k: service.ask("POST", "/v1/jobs", body))
    began, many = time.perf_counter(), 240
    with ThreadPoolExecutor(8) as clients:
        assert all(status == 202 for status, _ in clients.map(lambda k: service.ask("POST", "/v1/jobs", body), range(many)))
    one["a_second"] = many / (time.perf_counter() - began)
    service.stop()
    return one


def queue_of_equal_jobs(workers, jobs, *stores):
    """Seconds in which so many worker processes finish a queue of equal jobs."""
    service = Service("--workers", "0", *stores)
    body = jobs[0][1]
    ids = [json.loads(service.ask("POST", "/v1/jobs", body)[1])["id"] for _ in range(12)]
    began = time.perf_counter()
    line = [PROGRAM, "worker", "--log", "error", "--data", service.data, "--workers", "1", *stores]
    crew = [subprocess.Popen(line) for _ in range(workers)]
    found = [service.job(id) for id in ids]
    took = time.perf_counter() - began
    for worker in crew:
        worker.terminate()
        worker.wait()
    service.stop()
    return took, found


class Postgres:
    """A server of our own, as the tests have one."""

    def __enter__(self):
        self.folder = tempfile.mkdtemp(prefix="mapfit-pg-")
        programs = os.environ["MAPFIT_POSTGRES"]
        self.user = ["runuser", "-u", "postgres", "--"] if os.getuid() == 0 else []
        if self.user:
            subprocess.run(["chown", "postgres", self.folder], check=True)
        run = lambda *line: subprocess.run([*self.user, *line], check=True, stdout=subprocess.DEVNULL, cwd="/")
        run(f"{programs}/initdb", "--pgdata", f"{self.folder}/data", "--username", "mapfit", "--auth", "trust", "--encoding", "UTF8", "--locale", "C.UTF-8")
        self.port = 20000 + os.getpid() % 20000
        options = f"-c listen_addresses=127.0.0.1 -c port={self.port} -c unix_socket_directories={self.folder}"
        run(f"{programs}/pg_ctl", "-D", f"{self.folder}/data", "-o", options, "-l", f"{self.folder}/log", "-w", "start")
        self.count, self.programs = 0, programs
        return self

    def database(self):
        self.count += 1
        name = f"scale{self.count}"
        subprocess.run([f"{self.programs}/createdb", "-h", "127.0.0.1", "-p", str(self.port), "-U", "mapfit", name], check=True)
        return ["--database-url", f"postgres://mapfit@127.0.0.1:{self.port}/{name}"]

    def __exit__(self, *_):
        subprocess.run([*self.user, f"{self.programs}/pg_ctl", "-D", f"{self.folder}/data", "-m", "fast", "stop"], cwd="/", stdout=subprocess.DEVNULL)


def between(found):
    """What lies between a job's end and its worker's next start, in seconds: of one worker, that had more to do."""
    at = lambda job, member: time.mktime(time.strptime(job[member][:19], "%Y-%m-%dT%H:%M:%S")) + float(job[member][19:23])
    order = sorted(found, key=lambda job: at(job, "started"))
    return statistics.median(at(b, "started") - at(a, "finished") for a, b in zip(order, order[1:]))


OUT.mkdir(parents=True, exist_ok=True)
load = os.getloadavg()[0]
jobs = bodies()
print(len(jobs), "jobs of real logs", flush=True)
service, found = jobs_alone(jobs)
peak = service.memory()
print("jobs cost", statistics.mean(job["cpu"] for job in found), flush=True)
costs = {
    "machine": {
        "cpu": next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "unknown"),
        "cores": os.cpu_count(), "load": load, "date": time.strftime("%Y-%m-%d", time.gmtime()),
    },
    "jobs": found, "peak_bytes": peak, "requests": requests(service, jobs, found),
}
idle = service.cpu()
time.sleep(10)
costs["idle_cpu_share"] = (service.cpu() - idle) / 10
service.stop()
print(json.dumps(costs["requests"], indent=1), flush=True)
with Postgres() as postgres:
    stores = {"SQLite": lambda: [], "PostgreSQL": postgres.database}
    costs["submissions"] = {name: submissions(jobs, *store()) for name, store in stores.items()}
    print(costs["submissions"], flush=True)
    costs["speedup"] = {}
    for name, store in stores.items():
        # In turn, and each twice, so that others on the machine hit both alike; the better of the two counts.
        ones, twos = [], []
        for _ in range(2):
            one, alone = queue_of_equal_jobs(1, jobs, *store())
            two, _ = queue_of_equal_jobs(2, jobs, *store())
            ones.append(one)
            twos.append(two)
        costs["speedup"][name] = {"one": min(ones), "two": min(twos), "share": min(twos) / min(ones), "between": between(alone), "load": os.getloadavg()[0]}
        print(name, costs["speedup"][name], flush=True)
# A submission wakes an idle worker (tests/many_machines.rs holds it to 50 ms); this is about what it takes.
lines = [f"between,{costs['speedup']['PostgreSQL']['between']:.4f}", "pickup,0.02"]
lines += [f"service,{job['cpu']:.3f}" for job in found]
(OUT / "services.csv").write_text("\n".join(lines) + "\n")
for job in found:
    del job["map_id"]
(OUT / "costs.json").write_text(json.dumps(costs, indent=1) + "\n")
