"""A map's recording before PyPI's mcap readers. Arguments: a folder with map.mcap, ogm.json, grid.npz.

Every cell is the one of the JSON grid and of the npz arrays; the schemas that the file carries are enough to read it."""

import json
import sys
from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory
from mcap_ros2.decoder import DecoderFactory as RosFactory

folder = Path(sys.argv[1])
ogm = json.loads((folder / "ogm.json").read_text())
arrays = np.load(folder / "grid.npz")
with (folder / "map.mcap").open("rb") as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[RosFactory(), ProtobufFactory()])
    assert reader.get_header().profile == "ros2"
    messages = {channel.topic: (schema, message, decoded) for schema, channel, message, decoded in reader.iter_decoded_messages()}
    statistics = reader.get_summary().statistics
assert set(messages) == {"/map", "/grid", "/tf_static"} and statistics.message_count == 3

schema, message, grid = messages["/map"]
assert schema.name == "nav_msgs/msg/OccupancyGrid" and schema.encoding == "ros2msg"
assert grid.header.frame_id == "map" and list(grid.data) == ogm["data"]
info, origin = grid.info, ogm["info"]["origin"]["position"]
assert (info.width, info.height) == (ogm["info"]["width"], ogm["info"]["height"])
assert np.float32(ogm["info"]["resolution"]) == np.float32(info.resolution)
assert (info.origin.position.x, info.origin.position.y) == (origin["x"], origin["y"]) and info.origin.orientation.w == 1
made = np.datetime64(ogm["header"]["stamp"].rstrip("Z"), "ns").astype(int)
assert grid.header.stamp.sec * 10**9 + grid.header.stamp.nanosec == made == message.log_time == message.publish_time

schema, message, raster = messages["/grid"]
assert schema.name == "foxglove.Grid" and schema.encoding == "protobuf"
# Foxglove's own class reads the bytes as what the file's schema says.
own = Grid.FromString(message.data)
assert own.SerializeToString(deterministic=True) == raster.SerializeToString(deterministic=True)
fields = [(f.name, f.offset, f.type) for f in own.fields]
assert fields == [("distance", 0, PackedElementField.FLOAT32), ("sigma", 4, PackedElementField.FLOAT32)]
height, width = arrays["distance"].shape
assert (own.column_count, own.cell_stride, own.row_stride) == (width, 8, 8 * width) and own.frame_id == "map"
assert (own.cell_size.x, own.cell_size.y) == (arrays["resolution"], arrays["resolution"])
assert [own.pose.position.x, own.pose.position.y] == list(arrays["origin"]) and own.pose.orientation.w == 1
cells = np.frombuffer(own.data, dtype="<f4").reshape(height, width, 2)
for k, name in enumerate(["distance", "sigma"]):
    assert np.array_equal(cells[..., k], arrays[name], equal_nan=True), name
assert np.isnan(cells).any() and np.isfinite(cells).any()
assert own.timestamp.ToNanoseconds() == made

_, _, static = messages["/tf_static"]
[corner] = static.transforms
assert (corner.header.frame_id, corner.child_frame_id) == ("map", "lattice")
assert (corner.transform.translation.x, corner.transform.translation.y) == (origin["x"], origin["y"])
print("mcap's readers find every cell")
