"""A map's representations at the ends of their parameters: windows, grids, pictures, Accept and ranges."""

from .attack import Attack, Scene, get


def attacks(scene: Scene) -> list[Attack]:
    return [*windows(scene), *pictures(scene), *negotiation(scene)]


def windows(scene: Scene) -> list[Attack]:
    """Covariances: windows that touch the border, leave it, or wrap around."""
    big = 18446744073709551615
    found = []
    for name, map_id in (("sdf", scene.sdf), ("vdf", scene.vdf)):
        own = f"/v1/maps/{map_id}/covariance"
        for query in (
            f"i0={big}&j0=0&ni=1&nj=1",
            f"i0=1&j0=1&ni={big}&nj={big}",
            "i0=0&j0=0&ni=0&nj=0",
            "i0=-1&j0=0&ni=1&nj=1",
            "i0=0&j0=0&ni=1",
            "i0=99999&j0=0&ni=1&nj=1",
            "i0=0&j0=0&ni=1000&nj=1000",
            "i0=1.5&j0=0&ni=1&nj=1",
        ):
            found.append(get(f"{name} block {query[:40]}", f"{own}?form=block&{query}", "422"))
        for query in ("i0=0&j0=0&ni=1&nj=1", "i0=0&j0=0&ni=4&nj=4&kind=posterior"):
            found.append(get(f"{name} block {query[:40]}", f"{own}?form=block&{query}", "200", within=65.0))
        for query in (
            "form=full&format=json",
            "form=sparse&format=json",
            "form=factors&format=json",
            "form=x",
            "kind=x",
            "form=diagonal&i0=0",
        ):
            found.append(get(f"{name} covariance {query}", f"{own}?{query}", "4"))
        for query in ("form=sparse", "form=factors", "form=full", "form=diagonal&kind=posterior"):
            found.append(get(f"{name} covariance {query}", f"{own}?{query}", "200", "422", within=65.0))
    return found


def pictures(scene: Scene) -> list[Attack]:
    """Grids, contours and pictures at the ends of their parameters."""
    found = []
    for name, map_id in (("sdf", scene.sdf), ("vdf", scene.vdf)):
        own = f"/v1/maps/{map_id}"
        for query in (
            "ogm?resolution=1e-4",
            "ogm?resolution=0",
            "ogm?resolution=NaN",
            "ogm?resolution=1e400",
            "ogm?resolution=-1",
            "grid?resolution=1e-4",
            "grid?layers=",
            "grid?layers=x",
            "grid?layers=distance,,",
            "image?width=199",
            "image?width=4097",
            "image?width=1e3",
            "image?layer=x",
            "image?overlay=x",
            "contours?level=NaN",
            "contours?level=1e7",
            "contours?level=1e400",
            "contours?sigma_band=0",
            "contours?sigma_band=101",
            "contours?width=1",
            "coefficients?x=1",
            "poses?format=npz",
            "?x=1",
        ):
            found.append(get(f"{name} {query}", f"{own}/{query}".replace("/?", "?"), "4"))
        for query in (
            "ogm?resolution=1e4",
            "ogm?resolution=1e4&format=png",
            "ogm?resolution=1e4&format=zip",
            "grid?resolution=1e4",
            "grid?format=tiff&resolution=1e4",
            "grid?layers=distance,distance,distance",
            "image?width=4096",
            "image?width=200&format=svg&overlay=poses,points,contour,,contour",
            "contours?level=1e6",
            "contours?level=-1e6&sigma_band=100",
            "contours?sigma_band=0.001&format=png",
            "contours?level=5e-324",
            "contours?format=svg&width=4096&sigma_band=100",
            "image?layer=sigma&kind=posterior",
            "image?layer=occupancy",
        ):
            found.append(get(f"{name} {query}", f"{own}/{query}", "200", within=65.0))
    return found


def negotiation(scene: Scene) -> list[Attack]:
    """Accept, ranges and conditions, as odd as they come."""
    own = f"/v1/maps/{scene.sdf}/coefficients"
    accepts = [
        "text/html",
        "*/*;q=0",
        "*/*;q=NaN",
        "*/*;q=inf",
        "*/*;q=-1",
        "application/x-npz;q=1e400",
        ",,,",
        ";;;",
        "a/b/c",
        "*",
        "*/json",
        "application/*",
        "application/json;q=0.0, */*",
        ",".join(["text/x"] * 2000),
        "q=1",
        "application/json; charset=utf-16",
    ]
    found = [get(f"accept {accept[:30]}", own, "200", "406", "431", Accept=accept) for accept in accepts]
    for ranges in (
        "bytes=0-0",
        "bytes=-1",
        "bytes=9999999999-",
        "bytes=0-0,1-1,2-2",
        "bytes=5-1",
        "lines=1-2",
        "bytes=" + ",".join("0-" for _ in range(1000)),
    ):
        found.append(get(f"range {ranges[:20]}", own, "200", "206", "416", "431", Range=ranges))
    for tags in ("*", '"x"', 'W/"x"', "x" * 5000, ", , ,", '"' * 999):
        found.append(get(f"if-none-match {tags[:12]}", own, "200", "304", If_None_Match=tags))
    for coding in ("br", "zstd", "gzip;q=0", "identity;q=0", "*;q=0", "gzip, zstd, br", "x" * 3000, "gzip;q=NaN"):
        found.append(get(f"accept-encoding {coding[:20]}", own, "200", "406", Accept_Encoding=coding))
    return found
