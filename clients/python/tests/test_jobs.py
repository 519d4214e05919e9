"""Jobs: submitted once whatever happens, followed, cancelled, failed; lists over all their pages."""

import gzip
import json
from pathlib import Path

import pytest

from mapfit_client import Client, JobFailed, MapfitError
from mapfit_client.records import JobRecord

from .world import rooms, tiny


def test_from_a_job_to_its_map(client: Client) -> None:
    """What was submitted is there, numpy's arrays and NaN as the service wants them."""
    job = client.submit(tiny())
    assert job.name == "rooms, sdf" and job.labels["world"] == "rooms"
    fitted = job.wait(progress=False)
    assert job.status == "successful" and job.ended and fitted.id == job.map_id
    assert job.problem is None
    assert fitted.name == job.name and fitted.labels == job.labels and fitted.fit["converged"]
    ranges = job.request()["scans"][0]["ranges"]
    assert ranges[0] is None and ranges[1] == tiny()["scans"][0]["ranges"][1]
    assert client.job(job.id).map().id == fitted.id
    assert client.map(fitted.id).record == fitted.record
    assert job.id in repr(job) and fitted.id in repr(fitted) and "sdf" in repr(fitted)
    assert len(fitted.poses()) == 2
    fitted.delete()
    with pytest.raises(MapfitError, match="404"):
        client.map(fitted.id)


def test_progress_is_shown(client: Client, capsys: pytest.CaptureFixture[str]) -> None:
    """On a bar, or to whoever asks; and on neither."""
    heard: list[JobRecord] = []
    client.submit(tiny(2)).wait(progress=heard.append)
    assert heard[0]["status"] in ("accepted", "running", "successful")
    assert heard[-1]["status"] == "successful" and heard[-1]["progress"]["percent"] == 100
    capsys.readouterr()
    client.submit(tiny(3)).wait()
    shown = capsys.readouterr().err
    assert "rooms, sdf" in shown and "100%" in shown and "done" in shown
    client.submit(tiny(4)).wait(progress=False)
    assert capsys.readouterr().err == ""


def test_a_file_is_a_job(client: Client, tmp_path: Path) -> None:
    """JSON, gzipped or not, from a path or its name."""
    job = {**tiny(), "scans": [{**scan, "ranges": scan["ranges"][1:40].tolist()} for scan in tiny()["scans"]]}
    plain, packed = tmp_path / "job.json", tmp_path / "job.json.gz"
    plain.write_text(json.dumps(job))
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    requests = [client.submit(file).request() for file in (plain, str(plain), packed)]
    assert requests == [job] * 3
    plain.write_text("[1]")
    with pytest.raises(ValueError, match="an object of JSON"):
        client.submit(plain)
    with pytest.raises(ValueError, match="mapfit submit"):
        client.submit("drive.mcap")
    with pytest.raises(FileNotFoundError):
        client.submit("nowhere.json")


def test_one_key_one_job(client: Client) -> None:
    """The same body again is the same job; another body is refused; without a key there are two."""
    first, again = (client.submit(tiny(5), idempotency_key="tuesday") for _ in range(2))
    assert first.id == again.id
    with pytest.raises(MapfitError) as refused:
        client.submit(tiny(6), idempotency_key="tuesday")
    assert refused.value.problem["type"].endswith("idempotency-key-reused")
    assert client.submit(tiny(5)).id != client.submit(tiny(5)).id


def test_a_fault_is_named(client: Client) -> None:
    """Every one, with its pointer."""
    job = tiny()
    job["scans"][1]["range_max"] = "far"
    job["noise"] = {**job["noise"], "sigma_range": 0.0}
    with pytest.raises(MapfitError) as refused:
        client.submit(job)
    problem = refused.value.problem
    assert problem["status"] == 422 and problem["type"].endswith("/invalid-request")
    assert {fault.get("pointer") for fault in problem["errors"]} == {"/scans/1/range_max", "/noise/sigma_range"}
    assert "/scans/1/range_max" in str(refused.value)
    assert problem["request_id"]


def test_a_job_that_fails_says_why(client: Client) -> None:
    """`JobFailed` is a `MapfitError` with the job's problem."""
    # Ranges known to a micrometre on a lattice of half a metre: no f64 holds both.
    exact = dict.fromkeys(("sigma_x", "sigma_y", "sigma_theta", "sigma_range"), 1e-6)
    lattice = {"distance": "vdf", "resolution": 0.5}
    job = client.submit(tiny(noise=exact, fit={"model_sigma": 0}, map=lattice))
    with pytest.raises(JobFailed) as failed:
        job.wait(progress=False)
    assert isinstance(failed.value, MapfitError)
    assert job.status == "failed" and failed.value.problem == job.problem
    assert failed.value.job["id"] == job.id
    assert failed.value.problem["type"].startswith("/problems/")


def test_a_cancelled_job_has_no_map(client: Client) -> None:
    """Nor is a job cancelled twice."""
    fine = rooms("sdf") | {"map": {"distance": "sdf", "resolution": 0.05}}
    job = client.submit(fine)
    with pytest.raises(TimeoutError, match="it goes on"):
        job.wait(progress=False, timeout=0.2)
    assert not job.refresh().ended
    assert job.cancel().status == "dismissed"
    with pytest.raises(JobFailed, match="dismissed"):
        job.wait(progress=False)
    with pytest.raises(MapfitError) as refused:
        job.cancel()
    assert refused.value.problem["status"] == 409


def test_lists_go_over_all_pages(client: Client) -> None:
    """Newest first, chosen by label, state and place."""
    labels = {"list": "pages"}
    jobs = [client.submit(tiny(k, labels=labels)) for k in range(5)]
    maps = [job.wait(progress=False).id for job in jobs]
    assert [job.id for job in client.jobs(labels=labels, page_size=2)] == [job.id for job in reversed(jobs)]
    assert set(maps) == {listed.id for listed in client.maps(labels=labels, page_size=2)}
    assert len(list(client.jobs(labels=labels, status="failed"))) == 0
    assert len(list(client.maps(labels=labels, bbox=(5, 3, 7, 5)))) == 5
    assert len(list(client.maps(labels=labels, bbox=(90, 90, 91, 91)))) == 0
    with pytest.raises(MapfitError) as refused:
        list(client.jobs(page_size=0))
    assert refused.value.problem["errors"][0].get("parameter") == "limit"
