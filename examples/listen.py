"""Prints the velocities of a running rig as they are measured: python3 listen.py RIG

Needs: pip install iceoryx2==0.10.0 (the version that ricochet uses, because it determines the layout of shared memory).
Reading does not slow the rig down. A reader that is too slow loses its oldest messages and notices that in the sequence
numbers.
"""

import ctypes
import os
import sys
import time

import iceoryx2 as iox2

TRACKED = 11  # kind of the event after the last result


class Number(ctypes.Structure):
    """A number, and whether it was measured."""

    _fields_ = [("value", ctypes.c_double), ("known", ctypes.c_uint64)]


class Velocity(ctypes.Structure):
    """The velocity of one body in one frame: ricochet.Velocity.v2."""

    _fields_ = [(name, ctypes.c_uint64) for name in "run_id sequence stamp_ns".split()]
    _fields_ += [(name, ctypes.c_uint32) for name in "body status phase rotation_status points window_frames order".split()]
    _fields_ += [
        (name, Number)
        for name in (
            "center_x_px center_y_px radius_px dx_px dy_px dtheta_deg sigma_dx_px sigma_dy_px sigma_dtheta_deg "
            "vx_m_s vy_m_s vn_m_s vt_m_s omega_rad_s sigma_v_m_s sigma_omega_rad_s visible_fraction"
        ).split()
    ]

    @staticmethod
    def type_name():
        return "ricochet.Velocity.v2"


class Event(ctypes.Structure):
    """An event: ricochet.Event.v1."""

    _fields_ = [(name, ctypes.c_uint64) for name in "run_id sequence stamp_ns".split()]
    _fields_ += [("kind", ctypes.c_uint32), ("text_bytes", ctypes.c_uint32), ("text", ctypes.c_uint8 * 200)]

    @staticmethod
    def type_name():
        return "ricochet.Event.v1"


def join(rig):
    """Joins the shared memory of a rig of this user once the rig runs."""
    user = os.geteuid()
    folders = [os.path.join(os.environ.get("XDG_RUNTIME_DIR", f"/run/user/{user}"), "ricochet")]
    folders = [os.environ["RICOCHET_RUNTIME_DIR"]] if "RICOCHET_RUNTIME_DIR" in os.environ else folders
    folders += [f"/run/user/{user}/ricochet", os.path.join("/tmp", f"ricochet-{user}")]
    while True:
        for folder in folders:
            path = os.path.join(folder, "rigs", rig, "iceoryx2.toml")
            if os.path.exists(path) and os.stat(path).st_uid == user:
                config = iox2.config.from_file(iox2.FilePath.new(path))
                return iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
        time.sleep(0.01)


def open_topic(node, topic, message):
    """Opens a topic; raises an error if the rig does not run yet."""
    name = iox2.ServiceName.new(f"ricochet/{sys.argv[1]}/{topic}")
    service = node.service_builder(name).publish_subscribe(message).open()
    return service, service.subscriber_builder().buffer_size(4096).history_request(16).create()


def wait_for_rig(rig):
    """Opens the topics of a rig once it runs. A new run of a rig has new shared memory."""
    while True:
        node = join(rig)
        try:
            return node, open_topic(node, "velocity", Velocity), open_topic(node, "events", Event)
        except iox2.PublishSubscribeOpenError as error:
            if "DoesNotExist" not in str(error):
                raise
            time.sleep(0.01)


def take(subscriber):
    """Takes every message that has arrived."""
    while (sample := subscriber.receive()) is not None:
        yield sample.payload().contents
        sample.delete()


iox2.set_log_level(iox2.LogLevel.Fatal)
node, (velocity_service, velocities), (event_service, events) = wait_for_rig(sys.argv[1])
over = False
while not over:
    # Read before the velocities, so that none published before the end is missed.
    for event in take(events):
        over = event.kind == TRACKED
    for row in take(velocities):
        if row.vn_m_s.known:
            print(row.sequence, row.vn_m_s.value, row.vt_m_s.value, row.omega_rad_s.value if row.omega_rad_s.known else "-", flush=True)
    time.sleep(0.001)
