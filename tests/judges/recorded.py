"""Makes recordings of a ROS 2 robot (MCAP) from a CARMEN log, with PyPI's mcap and mcap-ros2-support: one that is as it
should be, and odd ones as robots leave them behind."""

import gzip
import io
import math
import struct
from dataclasses import dataclass
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer

RULE = "\n" + "=" * 80 + "\n"
TIME = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec"
HEADER = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id"
VECTOR = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z"
POINT = "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z"
QUATERNION = "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w"
POSE = "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation"
WITH_COVARIANCE = "MSG: geometry_msgs/PoseWithCovariance\ngeometry_msgs/Pose pose\nfloat64[36] covariance"
LASER = (
    "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\nfloat32 time_increment\n"
    "float32 scan_time\nfloat32 range_min\nfloat32 range_max\n"
)
TYPES = {
    "sensor_msgs/msg/LaserScan": RULE.join([LASER + "float32[] ranges\nfloat32[] intensities", HEADER, TIME]),
    "sensor_msgs/msg/MultiEchoLaserScan": RULE.join(
        [
            LASER + "sensor_msgs/LaserEcho[] ranges\nsensor_msgs/LaserEcho[] intensities",
            "MSG: sensor_msgs/LaserEcho\nfloat32[] echoes",
            HEADER,
            TIME,
        ]
    ),
    "tf2_msgs/msg/TFMessage": RULE.join(
        [
            "geometry_msgs/TransformStamped[] transforms",
            "MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\n"
            "geometry_msgs/Transform transform",
            "MSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
            VECTOR,
            QUATERNION,
            HEADER,
            TIME,
        ]
    ),
    "nav_msgs/msg/Odometry": RULE.join(
        [
            "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
            "geometry_msgs/TwistWithCovariance twist",
            WITH_COVARIANCE,
            "MSG: geometry_msgs/TwistWithCovariance\ngeometry_msgs/Twist twist\nfloat64[36] covariance",
            "MSG: geometry_msgs/Twist\ngeometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
            POSE,
            POINT,
            VECTOR,
            QUATERNION,
            HEADER,
            TIME,
        ]
    ),
    "geometry_msgs/msg/PoseWithCovarianceStamped": RULE.join(
        [
            "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose",
            WITH_COVARIANCE,
            POSE,
            POINT,
            QUATERNION,
            HEADER,
            TIME,
        ]
    ),
}
SCAN, ECHOES, TF, ODOMETRY, POSED = TYPES

SECOND = 10**9
START = 1_700_000_000 * SECOND
PERIOD = SECOND // 5
# Where the scanner sits on the robot: ahead, and turned nowhere.
AHEAD = 0.25


@dataclass
class Line:
    """A FLASER line."""

    ranges: list[float]
    pose: tuple[float, float, float]

    @property
    def step(self) -> float:
        return math.radians(1.0 if len(self.ranges) in (180, 181) else 0.5)


def log_lines(file: Path, count: int) -> tuple[list[str], list[Line]]:
    texts = [t for t in gzip.decompress(file.read_bytes()).decode("latin1").splitlines() if t.startswith("FLASER")]
    texts = texts[:count]
    lines = []
    for text in texts:
        words = text.split()
        beams = int(words[1])
        numbers = [float(word) for word in words[2 : 2 + beams + 3]]
        lines.append(Line(numbers[:beams], tuple(numbers[beams:])))
    return texts, lines


def stamp(time: int) -> dict:
    return {"sec": time // SECOND, "nanosec": time % SECOND}


def header(time: int, frame: str) -> dict:
    return {"stamp": stamp(time), "frame_id": frame}


def about_z(angle: float) -> dict:
    return {"x": 0.0, "y": 0.0, "z": math.sin(angle / 2), "w": math.cos(angle / 2)}


def transform(time, parent, child, x, y, rotation, z=0.0) -> dict:
    place = {"translation": {"x": x, "y": y, "z": z}, "rotation": rotation}
    return {"header": header(time, parent), "child_frame_id": child, "transform": place}


def robot_of(line: Line) -> tuple[float, float, float]:
    x, y, theta = line.pose
    return x - AHEAD * math.cos(theta), y - AHEAD * math.sin(theta), theta


def laser_scan(line: Line, time: int, frame="laser", head_down=False, time_increment=0.0) -> dict:
    ranges = list(reversed(line.ranges)) if head_down else line.ranges
    return {
        "header": header(time, frame),
        "angle_min": -math.pi / 2,
        "angle_max": -math.pi / 2 + (len(ranges) - 1) * line.step,
        "angle_increment": line.step,
        "time_increment": time_increment,
        "scan_time": 0.1,
        "range_min": 0.05,
        "range_max": 80.0,
        # What a scanner's driver writes where nothing came back.
        "ranges": [math.inf if r > 50 else r for r in ranges],
        "intensities": [],
    }


def echoes_of(scan: dict) -> dict:
    echoes = [{"echoes": [] if math.isinf(r) else [r, r + 1.0]} for r in scan["ranges"]]
    return {**scan, "ranges": echoes, "intensities": []}


class Robot:
    """A recording being made: messages are written with the time they are stamped with, unless told otherwise."""

    def __init__(self, compression=CompressionType.ZSTD, chunk_size=1 << 18):
        self.file = io.BytesIO()
        self.writer = Writer(self.file, compression=compression, chunk_size=chunk_size)
        self.types = {}

    def write(self, topic: str, kind: str, message: dict, time: int):
        if kind not in self.types:
            self.types[kind] = self.writer.register_msgdef(kind, TYPES[kind])
        self.writer.write_message(topic, self.types[kind], message, log_time=time, publish_time=time)

    def bytes(self) -> bytes:
        self.writer.finish()
        return self.file.getvalue()


def fixed(robot: Robot, frame="laser", rotation=None):
    there = transform(START, "base_link", frame, AHEAD, 0.0, rotation or about_z(0.0), z=0.4)
    robot.write("/tf_static", TF, {"transforms": [there]}, START)


def recording(
    lines: list[Line],
    *,
    poses="tf",
    static=True,
    shift=0,
    at=lambda k: START + k * PERIOD,
    scan_topics=("/scan",),
    head_down=False,
    echoes=False,
    covariance=None,
    time_increment=0.0,
    compression=CompressionType.ZSTD,
) -> bytes:
    """A robot's drive. `shift` is how far the poses' clock is ahead, `at` when the k-th scan was taken."""
    robot = Robot(compression)
    if static:
        fixed(robot, rotation={"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0} if head_down else None)
    for k, line in enumerate(lines):
        now, logged = at(k), START + (k + 1) * PERIOD
        x, y, theta = robot_of(line)
        there = {"position": {"x": x, "y": y, "z": 0.0}, "orientation": about_z(theta)}
        sure = {"pose": there, "covariance": covariance or [0.0] * 36}
        if poses == "tf":
            # map -> odom stays where it is; odom -> base_link has the motion.
            chain = [
                transform(now + shift, "map", "odom", 0.0, 0.0, about_z(0.0)),
                transform(now + shift, "odom", "base_link", x, y, about_z(theta)),
            ]
            robot.write("/tf", TF, {"transforms": chain}, logged)
        elif poses == "odometry":
            twist = {"twist": {"linear": {}, "angular": {}}, "covariance": [0.0] * 36}
            message = {"header": header(now + shift, "odom"), "child_frame_id": "base_link", "pose": sure, "twist": twist}
            robot.write("/odom", ODOMETRY, message, logged)
        elif poses == "posed":
            robot.write("/pose", POSED, {"header": header(now + shift, "map"), "pose": sure}, logged)
        for topic in scan_topics:
            scan = laser_scan(line, now, head_down=head_down, time_increment=time_increment)
            robot.write(topic, ECHOES if echoes else SCAN, echoes_of(scan) if echoes else scan, logged)
    return robot.bytes()


def rewritten(data: bytes, encoding="cdr", chunked=True) -> bytes:
    """The same messages in another file: said to be encoded otherwise, or without chunks."""
    file = io.BytesIO()
    writer = McapWriter(file, use_chunking=chunked)
    writer.start(profile="", library="test")
    channels = {}
    for schema, channel, message in make_reader(io.BytesIO(data)).iter_messages():
        if channel.id not in channels:
            kind = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[channel.id] = writer.register_channel(channel.topic, encoding, kind)
        writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
    writer.finish()
    return file.getvalue()


def record(opcode: int, content: bytes, length=None) -> bytes:
    return struct.pack("<BQ", opcode, len(content) if length is None else length) + content


MAGIC = b"\x89MCAP0\r\n"


def bomb(claimed: int) -> bytes:
    """A chunk that says it unpacks to so many bytes."""
    head = struct.pack("<QQQI", 0, 0, claimed, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", 0)
    return MAGIC + record(0x01, bytes(8)) + record(0x06, head)


def nothing_in_it() -> bytes:
    return Robot().bytes()
