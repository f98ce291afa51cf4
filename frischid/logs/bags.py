"""ROS 1 bags, ROS 2 bags and MCAP files, read without ROS: one topic's joint states as a `Table`.

A ``sensor_msgs/JointState`` message holds names and, in their order, positions, velocities and efforts. Row k of the
table is message k; its columns are

    t [ns]      header.stamp, when the state was measured (or ``t_record``: when the recorder got the message)
    q_<name>    position          v_<name>    velocity          tau_<name>    effort

Every message names its joints. One topic may carry messages of an arm and others of a gripper: messages of one set of
names make the table, and a note counts the others. Messages are read one chunk at a time, so that memory does not grow
with the file.

Files are opened by ``rosbags`` (.bag; folders and .db3 files of ROS 2) and ``mcap`` (.mcap), the
optional part ``ros``.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frischid.core.extras import install_command
from frischid.errors import InputError, UnknownNameError
from frischid.logs.mapping import LogMap
from frischid.logs.table import Table, joined

BAG_SUFFIXES = (".bag", ".db3", ".mcap")
JOINT_STATES = ("sensor_msgs/JointState", "sensor_msgs/msg/JointState")
COLUMN_OF_FIELD = {"position": "q", "velocity": "v", "effort": "tau"}
RECORDER_COLUMN = "t_record"
"""Column of the recorder's clock."""
FIRST_MESSAGES = 2000
"""Number of first messages that decide the joints and channels of a table."""
FIRST_NAMES = 50
"""Number of first messages of a topic that show the joints on it."""
MESSAGES_PER_TABLE = 65_536
"""Messages in memory at once: three channels of seven joints are 11 MB."""

Raw = Iterator[tuple[int, bytes]]


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: by its suffix, or a folder that holds the ``metadata.yaml`` of a ROS 2 bag."""
    return path.suffix.lower() in BAG_SUFFIXES or (path / "metadata.yaml").is_file()


def bag_form(form: LogMap) -> LogMap:
    """The mapping with the stamps of a bag: whole nanoseconds since 1970, too large for a double without rounding."""
    return replace(form, time_unit="ns", zero_time=True)


def bag_tables(
    path: Path, form: LogMap, joints: Sequence[str] | None = None, rows: int = MESSAGES_PER_TABLE
) -> Iterator[Table]:
    """Tables of at most `rows` consecutive messages of one topic.

    Parameters
    ----------
    path : Path
        A .bag, .db3 or .mcap file, or the folder of a ROS 2 bag.
    form : LogMap
        `LogMap.topic` names the topic; without it, the topic with most of the robot's joints is read. With ``time =
        "t_record"`` the recorder's clock is taken instead of the header's.
    joints : sequence of str, optional
        The robot's joints. If messages of several sets of joints are mixed, the set with most of these joints is read.

    Raises
    ------
    InputError
        The libraries are not installed, the file is damaged or not a bag, or it has no joint states.
    UnknownNameError
        The bag has no such topic of joint states.
    """
    if not path.exists():
        raise InputError(f"{path}: there is no such bag; check the path")
    with ExitStack() as stack:
        try:
            bag = (_open_mcap if path.suffix.lower() == ".mcap" else _open_rosbag)(path, stack)
            wanted = {*(joints or ()), *_referred(form)}
            topic = _topic(path, bag, form.topic, wanted)
            yield from _tables(path, form, topic, _states(bag, topic), wanted, rows)
        except (InputError, GeneratorExit):
            raise
        except Exception as error:  # the two libraries raise dozens of types for a damaged file
            raise InputError(
                f"{path}: cannot be read as a bag ({type(error).__name__}: {error}); was it closed and copied "
                "completely? `ros2 bag reindex`, `rosbag reindex` or `mcap recover` may restore it"
            ) from error


def topics_of(path: Path) -> dict[str, tuple[str, ...]]:
    """Topics of joint states of a bag, and the names of the joints in each one's first messages."""
    with _opened(path) as bag:
        return {topic: _names_on(bag, topic) for topic in bag.topics}


def message_bytes(path: Path) -> int:
    """Bytes of the joint states of a bag without compression: their number times the longest of the first ones."""
    with _opened(path) as bag:
        first = {topic: itertools.islice(bag.read(topic), FIRST_NAMES) for topic in bag.topics}
        longest = {topic: max((len(data) for _, data in messages), default=0) for topic, messages in first.items()}
    return max((bag.counts[topic] * size for topic, size in longest.items()), default=0)


@contextmanager
def _opened(path: Path) -> Iterator[_Bag]:
    """A bag to look into."""
    with ExitStack() as stack:
        try:
            yield (_open_mcap if path.suffix.lower() == ".mcap" else _open_rosbag)(path, stack)
        except InputError:
            raise
        except Exception as error:  # the two libraries raise dozens of types for a damaged file
            raise InputError(f"{path}: cannot be read as a bag ({type(error).__name__}: {error})") from error


def read_bag(path: Path, form: LogMap, joints: Sequence[str] | None = None) -> Table:
    """All messages of one topic as one table; see `bag_tables`."""
    return joined(list(bag_tables(path, form, joints)))


# ---------------------------------------------------------------------- messages


@dataclass(frozen=True)
class _Bag:
    """An open file: topics of joint states; of all topics the types and numbers of messages; how to read and decode."""

    topics: Sequence[str]
    others: Mapping[str, str]
    counts: Mapping[str, int]
    read: Callable[[str], Raw]
    decode: Callable[[bytes], Any]


@dataclass(frozen=True, eq=False)
class _State:
    """One message: its stamp [ns], and numbers in the order of `names`."""

    header: int
    recorded: int
    names: list[str]
    channels: dict[str, NDArray[np.float64]]


def _open_rosbag(path: Path, stack: ExitStack) -> _Bag:
    """Open a ROS 1 bag, or a ROS 2 bag (its folder, or one of its .db3 files)."""
    rosbag1, rosbag2 = _library("rosbags.rosbag1"), _library("rosbags.rosbag2")
    first = path.suffix.lower() == ".bag" and path.is_file()
    reader = stack.enter_context((rosbag1 if first else rosbag2).Reader(path))

    def read(topic: str) -> Raw:
        connections = [c for c in reader.connections if c.topic == topic and c.msgtype in JOINT_STATES]
        return ((stamp, data) for _, stamp, data in reader.messages(connections=connections))

    types = {c.topic: c.msgtype for c in reader.connections}
    counts: Counter[str] = Counter()
    for connection in reader.connections:
        counts[connection.topic] += connection.msgcount
    found = [n for n, kind in types.items() if kind in JOINT_STATES]
    return _Bag(found, types, counts, read, _decoder("ros1" if first else ""))


def _open_mcap(path: Path, stack: ExitStack) -> _Bag:
    """Open an MCAP file of ROS 1 or ROS 2 messages."""
    reader = _library("mcap.reader").make_reader(stack.enter_context(path.open("rb")))
    summary = reader.get_summary()
    if summary is None:
        raise InputError(f"{path}: the MCAP file was not closed (no summary); `mcap recover` writes a whole one")
    types = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values() if c.schema_id}
    numbers = {} if summary.statistics is None else summary.statistics.channel_message_counts
    counts: Counter[str] = Counter()
    for number, channel in summary.channels.items():
        counts[channel.topic] += numbers.get(number, 0)
    topics = [n for n, kind in types.items() if kind in JOINT_STATES]
    encodings = {c.message_encoding for c in summary.channels.values() if c.topic in topics}
    if unknown := encodings - {"cdr", "ros1"}:
        raise InputError(f"{path}: joint states encoded as {', '.join(unknown)} are not supported, only cdr and ros1")

    def read(topic: str) -> Raw:
        return ((message.log_time, message.data) for _, _, message in reader.iter_messages(topics=[topic]))

    return _Bag(topics, types, counts, read, _decoder("ros1" if "ros1" in encodings else ""))


def _decoder(kind: str) -> Callable[[bytes], Any]:
    typesys = _library("rosbags.typesys")
    # JointState is the same in every ROS 2 so far, so a bag's own definition is not used.
    if kind == "ros1":
        store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
        return lambda data: store.deserialize_ros1(data, JOINT_STATES[1])
    store = typesys.get_typestore(typesys.Stores.LATEST)
    return lambda data: store.deserialize_cdr(data, JOINT_STATES[1])


def _library(name: str) -> Any:
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError as error:
        raise InputError(f"reading bags and MCAP files needs more: {install_command('ros')} ({error})") from error


def _names_on(bag: _Bag, topic: str) -> tuple[str, ...]:
    """Names of the joints in the first messages of a topic."""
    head = itertools.islice(_states(bag, topic), FIRST_NAMES)
    return tuple(dict.fromkeys(name for state in head for name in state.names))


def _topic(path: Path, bag: _Bag, wanted: str | None, joints: set[str]) -> str:
    """The topic to read: the wanted one, the only one, or the one with most of the robot's joints.

    An error lists the topics where the choice is not clear.
    """
    if wanted is not None:
        if wanted not in bag.topics:
            raise UnknownNameError("topic of joint states", wanted, bag.topics, str(path))
        return wanted
    if len(bag.topics) == 1:
        return bag.topics[0]
    if not bag.topics:
        listing = ", ".join(f"{n} ({kind})" for n, kind in sorted(bag.others.items())) or "(none)"
        raise InputError(f"{path}: no topic of type sensor_msgs/JointState; the topics are {listing}")
    names = {topic: _names_on(bag, topic) for topic in sorted(bag.topics)}
    covered = {topic: len(joints.intersection(there)) for topic, there in names.items()}
    most = max(covered.values())
    if most and list(covered.values()).count(most) == 1:
        return max(covered, key=lambda topic: covered[topic])
    likely = max(names, key=lambda topic: len(names[topic]))
    raise InputError(
        f"{path}: several topics hold joint states: {', '.join(names)}; say which: "
        f'topic = "{likely}" under [file] in a mapping file (frischid map proposes one)'
    )


def _states(bag: _Bag, topic: str) -> Iterator[_State]:
    for recorded, data in bag.read(topic):
        message = bag.decode(data)
        stamp = message.header.stamp
        channels = {name: getattr(message, name) for name in COLUMN_OF_FIELD}
        yield _State(stamp.sec * 1_000_000_000 + stamp.nanosec, recorded, message.name, channels)


# ---------------------------------------------------------------------- tables


def _referred(form: LogMap) -> set[str]:
    """Names of joints in the bag that a mapping refers to, as ``q_<name>``."""
    return {str(entry.q).removeprefix("q_") for entry in form.joint.values() if entry.q is not None}


def _tables(
    path: Path, form: LogMap, topic: str, states: Iterator[_State], wanted: set[str], rows: int
) -> Iterator[Table]:
    head = list(itertools.islice(states, FIRST_MESSAGES))
    if not head:
        raise InputError(f"{path}: topic {topic} holds no message; was the robot's driver running?")
    if form.time != RECORDER_COLUMN and not any(state.header for state in head):
        raise InputError(
            f"{path}: the header stamps of topic {topic} are all zero; to take the time at which the recorder got each "
            f'message instead, set time = "{RECORDER_COLUMN}" under [file] in a mapping file'
        )
    sets = Counter(tuple(sorted(state.names)) for state in head)
    chosen = max(sets, key=lambda names: (len(wanted.intersection(names)), sets[names]))
    collect = _Collector(path, form.time, topic, next(s for s in head if tuple(sorted(s.names)) == chosen))
    states = itertools.chain(head, states)
    while table := collect.table(states, rows):
        yield table


class _Collector:
    """Gathers the messages of one set of joints into tables."""

    def __init__(self, path: Path, time: str | int, topic: str, sample: _State) -> None:
        self.path, self.topic, self.names = path, topic, sample.names
        self.channels = [channel for channel in COLUMN_OF_FIELD if len(sample.channels[channel])]
        self.recorded = time == RECORDER_COLUMN
        self.done = 0
        self.others: Counter[str] = Counter()

    def table(self, states: Iterator[_State], rows: int) -> Table | None:
        """Return the next `rows` messages; None when there are no more."""
        stamps = np.empty(rows, dtype=np.int64)
        values = np.empty((len(self.channels), len(self.names), rows))
        count = 0
        while count < rows and (state := next(states, None)) is not None:
            order = self._order(state)
            if order is None:
                continue
            stamps[count] = state.recorded if self.recorded else state.header
            values[:, :, count] = self._numbers(state, self.done + count)[:, order]
            count += 1
        if count == 0:
            return None
        columns: dict[str, NDArray[Any]] = {RECORDER_COLUMN if self.recorded else "t": stamps[:count]}
        for c, channel in enumerate(self.channels):
            columns |= {f"{COLUMN_OF_FIELD[channel]}_{name}": values[c, j, :count] for j, name in enumerate(self.names)}
        table = Table(str(self.path), tuple(columns), columns, {}, self._place(self.done), notes=self._notes())
        self.done += count
        return table

    def _order(self, state: _State) -> slice | list[int] | None:
        """Position of each joint in a message; None if the message is of other joints."""
        if state.names == self.names:
            return slice(None)
        if sorted(state.names) == sorted(self.names):
            return [state.names.index(name) for name in self.names]
        self.others[", ".join(state.names)] += 1
        return None

    def _numbers(self, state: _State, row: int) -> NDArray[np.float64]:
        J = len(self.names)
        for channel in COLUMN_OF_FIELD:
            expected = J if channel in self.channels else 0
            if len(state.channels[channel]) != expected:
                raise InputError(
                    f"{self.path}: {self._place(0)(row)} holds {len(state.channels[channel])} numbers of {channel}, "
                    f"the messages before it {expected}; cut the bag there and read the parts one by one"
                )
        return np.array([state.channels[channel] for channel in self.channels])

    def _place(self, before: int) -> Callable[[int], str]:
        return lambda row: f"message {before + row + 1} of topic {self.topic}"

    def _notes(self) -> tuple[str, ...]:
        notes = [f"joint states of topic {self.topic}: {', '.join(self.names)}"]
        notes += [f"{count} messages of {who} on the same topic left out" for who, count in self.others.items()]
        return tuple(notes)
