"""Bags of a log, written by the libraries themselves."""

from pathlib import Path

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer as McapRos2Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

KIND = "sensor_msgs/msg/JointState"
BEGIN = 1_700_000_000_000_000_000
DEFINITION = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec"""


def stamps_of(log):
    return BEGIN + np.round(1e9 * log.t).astype(np.int64)


def messages(log, store, *, header=True, order=None):
    """(Stamp, message) of each sample, the joints of a message in `order`."""
    order = list(order or range(len(log.joints)))
    names = [log.joints[j] for j in order]
    time, head, state = (
        store.types[f"{kind}"] for kind in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header", KIND)
    )
    none = np.empty((len(log), 0))
    q, v, tau = (np.ascontiguousarray(none if x is None else x[:, order], dtype=float) for x in (log.q, log.v, log.tau))
    for k, stamp in enumerate(stamps_of(log).tolist()):
        at = time(*(divmod(stamp, 10**9) if header else (0, 0)))
        top = head(stamp=at, frame_id="", **({"seq": k} if "seq" in head.__dataclass_fields__ else {}))
        yield stamp, state(top, names, q[k], v[k], tau[k])


def ros1(log, path, topic="/joint_states", **options):
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(path) as writer:
        connection = writer.add_connection(topic, KIND, typestore=store)
        for stamp, message in messages(log, store, **options):
            writer.write(connection, stamp, store.serialize_ros1(message, KIND))
    return path


def ros2(log, path, topic="/joint_states", storage=StoragePlugin.SQLITE3, others=(), **options):
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer2(path, version=9, storage_plugin=storage) as writer:
        connections = {n: writer.add_connection(n, KIND, typestore=store) for n in (topic, *dict(others))}
        for name, data, how in [(topic, log, options), *((n, x, {}) for n, x in dict(others).items())]:
            for stamp, message in messages(data, store, **how):
                writer.write(connections[name], stamp + 2_000_000, store.serialize_cdr(message, KIND))
    return path


def ros2_mcap(log, path, **options):
    return ros2(log, path, storage=StoragePlugin.MCAP, **options)


def ros2_db3(log, path, **options):
    return next(ros2(log, Path(path).with_suffix(""), **options).glob("*.db3"))


def mcap_ros2(log, path, topic="/joint_states", pieces=None, compressed=True):
    """An MCAP file by the mcap-ros2-support library; `pieces` (logs in order) are streamed instead of `log`."""
    with Path(path).open("wb") as file:
        writer = McapRos2Writer(file, compression=CompressionType.ZSTD if compressed else CompressionType.NONE)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", DEFINITION)
        for part in pieces or [log]:
            rows = [None if x is None else x.tolist() for x in (part.q, part.v, part.tau)]
            for k, stamp in enumerate(stamps_of(part).tolist()):
                q, v, tau = ([] if x is None else x[k] for x in rows)
                sec, nanosec = divmod(stamp, 10**9)
                header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""}
                message = {"header": header, "name": list(part.joints), "position": q, "velocity": v, "effort": tau}
                writer.write_message(topic, schema, message, log_time=stamp)
        writer.finish()
    return path


def mcap_ros1(log, path, topic="/joint_states"):
    store = get_typestore(Stores.ROS1_NOETIC)
    with Path(path).open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros1")
        text = store.generate_msgdef(KIND)[0].encode()
        schema = writer.register_schema("sensor_msgs/JointState", "ros1msg", text)
        channel = writer.register_channel(topic, "ros1", schema)
        for stamp, message in messages(log, store):
            writer.add_message(channel, stamp, bytes(store.serialize_ros1(message, KIND)), stamp)
        writer.finish()
    return path


WRITERS = {
    "ros1.bag": ros1,
    "ros2": ros2,
    "ros2_mcap": ros2_mcap,
    "ros2.db3": ros2_db3,
    "ros2.mcap": mcap_ros2,
    "ros1.mcap": mcap_ros1,
}
