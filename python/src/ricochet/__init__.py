"""Listens to a running ricochet rig, and reads its recordings.

    import ricochet

    for sample in ricochet.listen("velocity", rig="lacrosse"):
        print(sample["frame"], sample["vn_m_s"])

Reading does not slow the rig down. A reader that is too slow loses its oldest samples, and sees it in the frame numbers.
"""

import ctypes
import io
import subprocess
import time

import iceoryx2 as iox2
import numpy

from . import _messages as messages
from ._rig import RigError, Topic

__all__ = ["Frame", "RigError", "frames", "listen", "read"]

_TOPICS = {
    "velocity": messages.Velocity,
    "track": messages.Track,
    "impact": messages.Impact,
    "events": messages.Event,
    "status": messages.Status,
}
#: The event after the last result of a stream, and the one after its last frame.
_TRACKED, _ENDED = 11, 3
_PAUSE_S = 0.0005
_ALIVE_S = 1.0
_WORDS = {
    "status": messages.STATUS,
    "rotation_status": messages.STATUS,
    "phase": messages.PHASE,
    "force_law": messages.FORCE_LAW,
    "kind": messages.EVENT,
}


def _value(value):
    """Returns a number, or None where nothing was measured; messages within messages as dictionaries."""
    if isinstance(value, messages.Number):
        return value.value if value.known else None
    if isinstance(value, messages.Estimate):
        return (value.value, value.sigma) if value.known else None
    if isinstance(value, ctypes.Structure):
        return {name: _value(getattr(value, name)) for name, _ in value._fields_}
    if isinstance(value, ctypes.Array):
        return list(value)
    return value


def _row(message, topic):
    """Returns a message as a dictionary with the names of the table's columns."""
    row = {}
    for name, kind in message._fields_:
        row[name] = _value(getattr(message, name))
        if kind is messages.Estimate:
            row[name], row[f"sigma_{name}"] = row[name] or (None, None)
    if "sequence" in row:
        row["frame"] = row.pop("sequence")
    if topic == "events":
        row["text"] = bytes(message.text[: message.text_bytes]).decode("utf-8", "replace")
        del row["text_bytes"]
    if topic != "status":
        for name, words in _WORDS.items():
            if name in row:
                row[name] = words.get(row[name], row[name])
    return row


def listen(topic, rig="rig", wait_s=0.0):
    """Yields each sample of a topic as a dictionary, until the rig ends.

    topic: velocity, track, impact, events or status. wait_s: the time to wait for a rig that does not run yet.
    Raises RigError with one line.
    """
    if topic not in _TOPICS:
        raise RigError(f"no topic {topic!r}; topics: {', '.join(_TOPICS)}")
    source = Topic(rig, topic, _TOPICS[topic], wait_s=wait_s)
    end = _End(rig)
    while True:
        over = end.has_come()
        while (sample := source.take()) is not None:
            row = _row(sample.payload().contents, topic)
            sample.delete()
            yield row
        if over:
            return
        time.sleep(_PAUSE_S)


class _End:
    """The end of a stream: its event, read before the samples so that none is missed."""

    def __init__(self, rig, kind=_TRACKED):
        self._events = Topic(rig, "events", messages.Event, wait_s=_ALIVE_S)
        self._kind = kind

    def has_come(self):
        over = False
        while (event := self._events.take()) is not None:
            over |= event.payload().contents.kind == self._kind
            event.delete()
        return over


class Frame:
    """A frame in shared memory. Its pixels are valid as long as it exists."""

    def __init__(self, sample):
        self._sample = sample
        header = sample.user_header().contents
        self.sequence, self.stamp_ns, self.epoch = header.sequence, header.stamp_ns, header.epoch
        payload = sample.payload()
        raw = (ctypes.c_uint8 * payload.number_of_elements).from_address(payload.data_ptr)
        raw = numpy.frombuffer(raw, numpy.uint8)[: header.stride_bytes * header.height_px]
        # Two bytes for the formats of more than 8 bits.
        kind = numpy.dtype("<u2") if header.stride_bytes >= 2 * header.width_px else numpy.dtype("u1")
        rows = raw.reshape(header.height_px, header.stride_bytes).view(kind)
        #: The grey levels as an array of rows, without a copy. Do not write to it.
        self.pixels = rows[:, : header.width_px]
        self.pixels.flags.writeable = False

    def release(self):
        """Returns the slot to the ring. The pixels are invalid afterwards."""
        self.pixels = None
        if self._sample is not None:
            self._sample.delete()
            self._sample = None

    def __del__(self):
        self.release()


def frames(rig="rig", wait_s=0.0):
    """Yields the newest frames, each valid until the next one, until the stream ends."""
    source = Topic(rig, "frames", iox2.Slice[ctypes.c_uint8], header=messages.FrameHeader, wait_s=wait_s, queue=1)
    end = _End(rig, _ENDED)
    while True:
        over = end.has_come()
        while (sample := source.take()) is not None:
            frame = Frame(sample)
            yield frame
            frame.release()
        if over:
            return
        time.sleep(_PAUSE_S)


def read(recording, topic="velocity", program="ricochet"):
    """Returns a table of a recording as a pandas.DataFrame, by the installed program."""
    import pandas

    command = [program, "export", str(recording), "--topic", topic]
    done = subprocess.run(command, capture_output=True)
    # 6: the recording is cut off; its rows are complete up to there.
    if done.returncode not in (0, 6):
        raise RigError(done.stderr.decode("utf-8", "replace").strip())
    return pandas.read_csv(io.BytesIO(done.stdout))
