"""Finds a rig and opens its topics."""

import ctypes
import os
import time

import iceoryx2 as iox2


class RigError(RuntimeError):
    """A rig that cannot be listened to; the message is one line."""


class _Absent(RigError):
    """A rig that does not run, or not yet."""

    def __init__(self, rig):
        super().__init__(f"no rig named {rig!r} of this user runs; start it, or pass the name in its file")


def _folders():
    user = os.geteuid()
    if "RICOCHET_RUNTIME_DIR" in os.environ:
        yield os.environ["RICOCHET_RUNTIME_DIR"]
    elif "XDG_RUNTIME_DIR" in os.environ:
        yield os.path.join(os.environ["XDG_RUNTIME_DIR"], "ricochet")
    yield f"/run/user/{user}/ricochet"
    yield os.path.join("/tmp", f"ricochet-{user}")


def _config(rig):
    """Returns the iceoryx2 configuration of a running rig of this user, or None."""
    for folder in _folders():
        path = os.path.join(folder, "rigs", rig, "iceoryx2.toml")
        try:
            if os.stat(path).st_uid == os.geteuid():
                return iox2.config.from_file(iox2.FilePath.new(path))
        except OSError:
            continue
    return None


def _details(kind, variant, alignment=None):
    return (
        iox2.TypeDetail.new()
        .type_variant(variant)
        .type_name(iox2.TypeName.new(kind.type_name()))
        .size(ctypes.sizeof(kind))
        .alignment(alignment or ctypes.alignment(kind))
    )


class Topic:
    """An open topic of a rig."""

    def __init__(self, rig, topic, message, header=None, wait_s=0.0, queue=4096):
        iox2.set_log_level(iox2.LogLevel.Fatal)
        deadline = time.monotonic() + max(wait_s, 0.0)
        while True:
            try:
                self._open(rig, topic, message, header, queue)
                return
            except RigError as error:
                if not isinstance(error, _Absent) or time.monotonic() >= deadline:
                    raise
            time.sleep(0.01)

    def _open(self, rig, topic, message, header, queue):
        config = _config(rig)
        if config is None:
            raise _Absent(rig)
        self.node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
        builder = self.node.service_builder(iox2.ServiceName.new(f"ricochet/{rig}/{topic}"))
        if header is None:
            builder = builder.publish_subscribe(message)
        else:
            builder = builder.publish_subscribe(message).user_header(header)
            # ctypes of older Pythons cannot align a structure to 64 bytes.
            details = _details(header, iox2.TypeVariant.FixedSize, header.ALIGNMENT_BYTES)
            builder = getattr(builder, "__user_header_type_details")(details)
            getattr(builder, "__set_user_header_type")(header)
        try:
            self.service = builder.open()
        except iox2.PublishSubscribeOpenError as failure:
            if "DoesNotExist" in str(failure):
                raise _Absent(rig) from None
            wanted = (header or message).type_name()
            raise RigError(f"rig {rig!r} is of another version: this package reads {wanted} ({failure})") from None
        subscriber = self.service.subscriber_builder().buffer_size(queue)
        self.subscriber = subscriber.create()

    def take(self):
        """Returns the next sample, or None."""
        return self.subscriber.receive()
