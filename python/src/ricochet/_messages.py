"""The messages of a rig in shared memory and its datagrams, made by `ricochet bindings python`."""

import ctypes


class Number(ctypes.Structure):
    _fields_ = [
        ("value", ctypes.c_double),
        ("known", ctypes.c_uint64),
    ]
    SIZE_BYTES = 16
    ALIGNMENT_BYTES = 8

    @staticmethod
    def type_name():
        return "ricochet.Number.v1"


class Estimate(ctypes.Structure):
    _fields_ = [
        ("value", ctypes.c_double),
        ("sigma", ctypes.c_double),
        ("known", ctypes.c_uint64),
    ]
    SIZE_BYTES = 24
    ALIGNMENT_BYTES = 8

    @staticmethod
    def type_name():
        return "ricochet.Estimate.v1"


class Rod(ctypes.Structure):
    _fields_ = [
        ("known", ctypes.c_uint32),
        ("edges", ctypes.c_uint32),
        ("edge_status", ctypes.c_uint32 * 4),
        ("edge_known", ctypes.c_uint32 * 4),
        ("edge_px", ctypes.c_double * 4),
        ("sigma_edge_px", ctypes.c_double * 4),
        ("x_px", ctypes.c_double),
        ("sigma_x_px", ctypes.c_double),
        ("y_px", ctypes.c_double),
        ("sigma_y_px", ctypes.c_double),
        ("half_width_px", ctypes.c_double),
        ("sigma_half_width_px", ctypes.c_double),
        ("tilt_deg", ctypes.c_double),
        ("sigma_tilt_deg", ctypes.c_double),
    ]
    SIZE_BYTES = 168
    ALIGNMENT_BYTES = 8

    @staticmethod
    def type_name():
        return "ricochet.Rod.v1"


class FrameHeader(ctypes.Structure):
    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("device_ns", ctypes.c_uint64),
        ("run_id", ctypes.c_uint64),
        ("width_px", ctypes.c_uint32),
        ("height_px", ctypes.c_uint32),
        ("stride_bytes", ctypes.c_uint32),
        ("pixel_format", ctypes.c_uint32),
        ("epoch", ctypes.c_uint32),
        ("exposure_ns", ctypes.c_uint32),
        ("shot", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]
    SIZE_BYTES = 64
    ALIGNMENT_BYTES = 64

    @staticmethod
    def type_name():
        return "ricochet.FrameHeader.v1"


class FieldHeader(ctypes.Structure):
    _fields_ = [
        ("run_id", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
        ("target_sequence", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("body", ctypes.c_uint32),
        ("interval_frames", ctypes.c_uint32),
        ("status", ctypes.c_uint32),
        ("points", ctypes.c_uint32),
        ("worker", ctypes.c_uint32),
        ("outline", ctypes.c_uint32),
        ("method", ctypes.c_uint32),
        ("exposure_ns", ctypes.c_uint32),
        ("rotation_status", ctypes.c_uint32),
        ("skipped_frames", ctypes.c_uint32),
        ("center_x_px", ctypes.c_double),
        ("center_y_px", ctypes.c_double),
        ("radius_px", ctypes.c_double),
        ("sigma_center_px", ctypes.c_double),
        ("sigma_radius_px", ctypes.c_double),
        ("visible_fraction", ctypes.c_double),
        ("rim_fraction", ctypes.c_double),
        ("dx_px", ctypes.c_double),
        ("dy_px", ctypes.c_double),
        ("dtheta_deg", ctypes.c_double),
        ("sigma_dx_px", ctypes.c_double),
        ("sigma_dy_px", ctypes.c_double),
        ("sigma_dtheta_deg", ctypes.c_double),
        ("fixed_fraction", Number),
        ("light_fraction", Number),
        ("pull_px", Number),
        ("growth_fraction", Number),
        ("sigma_growth_fraction", ctypes.c_double),
        ("drift_x_px", Number),
        ("drift_y_px", Number),
        ("sigma_drift_px", ctypes.c_double),
        ("drift_deg", Number),
        ("sigma_drift_deg", ctypes.c_double),
        ("angle_deg", Number),
        ("sigma_angle_deg", ctypes.c_double),
        ("rod", Rod),
    ]
    SIZE_BYTES = 504
    ALIGNMENT_BYTES = 8

    @staticmethod
    def type_name():
        return "ricochet.FieldHeader.v9"


class FieldPoint(ctypes.Structure):
    _fields_ = [
        ("x_px", ctypes.c_float),
        ("y_px", ctypes.c_float),
        ("u_px", ctypes.c_float),
        ("v_px", ctypes.c_float),
        ("sigma_u_px", ctypes.c_float),
        ("sigma_v_px", ctypes.c_float),
        ("zncc", ctypes.c_float),
        ("peak_ratio", ctypes.c_float),
        ("status", ctypes.c_uint32),
    ]
    SIZE_BYTES = 36
    ALIGNMENT_BYTES = 4

    @staticmethod
    def type_name():
        return "ricochet.FieldPoint.v1"


class Track(ctypes.Structure):
    _fields_ = [
        ("run_id", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("body", ctypes.c_uint32),
        ("status", ctypes.c_uint32),
        ("center_x_px", Number),
        ("center_y_px", Number),
        ("angle_deg", Number),
        ("radius_px", Number),
        ("sigma_center_px", Number),
        ("sigma_angle_deg", Number),
        ("visible_fraction", Number),
        ("rod", Rod),
    ]
    SIZE_BYTES = 312
    ALIGNMENT_BYTES = 8

    @staticmethod
    def type_name():
        return "ricochet.Track.v2"


class Velocity(ctypes.Structure):
    _fields_ = [
        ("run_id", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("body", ctypes.c_uint32),
        ("status", ctypes.c_uint32),
        ("phase", ctypes.c_uint32),
        ("rotation_status", ctypes.c_uint32),
        ("points", ctypes.c_uint32),
        ("window_frames", ctypes.c_uint32),
        ("order", ctypes.c_uint32),
        ("center_x_px", Number),
        ("center_y_px", Number),
        ("radius_px", Number),
        ("dx_px", Number),
        ("dy_px", Number),
        ("dtheta_deg", Number),
        ("sigma_dx_px", Number),
        ("sigma_dy_px", Number),
        ("sigma_dtheta_deg", Number),
        ("vx_m_s", Number),
        ("vy_m_s", Number),
        ("vn_m_s", Number),
        ("vt_m_s", Number),
        ("omega_rad_s", Number),
        ("sigma_v_m_s", Number),
        ("sigma_omega_rad_s", Number),
        ("visible_fraction", Number),
    ]
    SIZE_BYTES = 328
    ALIGNMENT_BYTES = 8

    @staticmethod
    def type_name():
        return "ricochet.Velocity.v2"


class VelocityDatagram(ctypes.Structure):
    _fields_ = [
        ("version", ctypes.c_uint32),
        ("known", ctypes.c_uint32),
        ("number", ctypes.c_uint64),
        ("run_id", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("body", ctypes.c_uint32),
        ("status", ctypes.c_uint32),
        ("phase", ctypes.c_uint32),
        ("rotation_status", ctypes.c_uint32),
        ("center_x_px", ctypes.c_double),
        ("center_y_px", ctypes.c_double),
        ("vx_m_s", ctypes.c_double),
        ("vy_m_s", ctypes.c_double),
        ("vn_m_s", ctypes.c_double),
        ("vt_m_s", ctypes.c_double),
        ("omega_rad_s", ctypes.c_double),
        ("sigma_v_m_s", ctypes.c_double),
        ("sigma_omega_rad_s", ctypes.c_double),
    ]
    SIZE_BYTES = 128
    ALIGNMENT_BYTES = 8

    @staticmethod
    def type_name():
        return "ricochet.VelocityDatagram.v1"


class Impact(ctypes.Structure):
    _fields_ = [
        ("run_id", ctypes.c_uint64),
        ("origin_ns", ctypes.c_uint64),
        ("body", ctypes.c_uint32),
        ("number", ctypes.c_uint32),
        ("revision", ctypes.c_uint32),
        ("force_law", ctypes.c_uint32),
        ("status", ctypes.c_uint32),
        ("force_law_probability", ctypes.c_float),
        ("start_s", Estimate),
        ("deepest_s", Estimate),
        ("end_s", Estimate),
        ("vn_before_m_s", Estimate),
        ("vn_after_m_s", Estimate),
        ("vt_before_m_s", Estimate),
        ("vt_after_m_s", Estimate),
        ("omega_before_rad_s", Estimate),
        ("omega_after_rad_s", Estimate),
        ("restitution", Estimate),
        ("restitution_tangential", Estimate),
        ("impulse_ratio", Estimate),
        ("contact_time_s", Estimate),
        ("compression_max_mm", Estimate),
        ("acceleration_max_m_s2", Estimate),
        ("slip_end_s", Estimate),
        ("force_start_s", Estimate),
        ("force_end_s", Estimate),
        ("force_max_n", Estimate),
        ("energy_lost_j", Estimate),
        ("gravity_m_s2", Estimate),
        ("growth_before_per_s", Estimate),
        ("growth_after_per_s", Estimate),
    ]
    SIZE_BYTES = 592
    ALIGNMENT_BYTES = 8

    @staticmethod
    def type_name():
        return "ricochet.Impact.v4"


class Event(ctypes.Structure):
    _fields_ = [
        ("run_id", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("kind", ctypes.c_uint32),
        ("text_bytes", ctypes.c_uint32),
        ("text", ctypes.c_uint8 * 200),
    ]
    SIZE_BYTES = 232
    ALIGNMENT_BYTES = 8

    @staticmethod
    def type_name():
        return "ricochet.Event.v1"


class Status(ctypes.Structure):
    _fields_ = [
        ("run_id", ctypes.c_uint64),
        ("role", ctypes.c_uint32),
        ("index", ctypes.c_uint32),
        ("pid", ctypes.c_uint32),
        ("state", ctypes.c_uint32),
        ("sequence", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("taken", ctypes.c_uint64),
        ("given", ctypes.c_uint64),
        ("lost", ctypes.c_uint64),
        ("dropped", ctypes.c_uint64),
        ("restarts", ctypes.c_uint64),
        ("waiting", ctypes.c_uint64),
        ("capacity", ctypes.c_uint64),
        ("rate_hz", ctypes.c_double),
        ("latency_s", ctypes.c_double),
        ("row_latency_median_s", ctypes.c_double),
        ("row_latency_p99_s", ctypes.c_double),
        ("row_latency_p999_s", ctypes.c_double),
        ("row_latency_max_s", ctypes.c_double),
        ("row_latency_deviation_s", ctypes.c_double),
    ]
    SIZE_BYTES = 152
    ALIGNMENT_BYTES = 8

    @staticmethod
    def type_name():
        return "ricochet.Status.v2"


class Progress(ctypes.Structure):
    _fields_ = [
        ("run_id", ctypes.c_uint64),
        ("next_sequence", ctypes.c_uint64),
        ("role", ctypes.c_uint32),
        ("index", ctypes.c_uint32),
        ("done", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]
    SIZE_BYTES = 32
    ALIGNMENT_BYTES = 8

    @staticmethod
    def type_name():
        return "ricochet.Progress.v1"


class Request(ctypes.Structure):
    _fields_ = [
        ("command", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]
    SIZE_BYTES = 8
    ALIGNMENT_BYTES = 4

    @staticmethod
    def type_name():
        return "ricochet.Request.v1"


class Reply(ctypes.Structure):
    _fields_ = [
        ("code", ctypes.c_uint32),
        ("armed", ctypes.c_uint32),
        ("recordings", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
    ]
    SIZE_BYTES = 24
    ALIGNMENT_BYTES = 8

    @staticmethod
    def type_name():
        return "ricochet.Reply.v1"


STATUS = {
    0: "valid",
    1: "low-contrast",
    2: "low-correlation",
    3: "ambiguous",
    4: "outlier",
    5: "occluded",
    6: "out-of-frame",
    7: "lost",
    8: "predicted",
}


PHASE = {
    0: "unknown",
    1: "flight",
    2: "contact",
    3: "rebound",
}


EVENT = {
    1: "prepared",
    2: "started",
    3: "ended",
    4: "armed",
    5: "disarmed",
    6: "triggered",
    7: "recorded",
    8: "lost",
    9: "restarted",
    10: "camera",
    11: "tracked",
    12: "storage",
    13: "decided",
    14: "state",
    15: "action",
    16: "contact",
    17: "deepest",
    18: "withdrawn",
    19: "matched",
    20: "silent",
    21: "hung",
    22: "behind",
    23: "remeasured",
}


FORCE_LAW = {
    0: "none",
    1: "kelvin-voigt",
    2: "hunt-crossley",
    3: "power-law",
}


ROLE = {
    1: "acquire",
    2: "correlate",
    3: "track",
    4: "record",
    5: "run",
    6: "serve",
}


BODY_KIND = {
    0: "ball",
    1: "rod",
    2: "patch",
}


DATAGRAM_BIT = {
    0: "center_x_px",
    1: "center_y_px",
    2: "vx_m_s",
    3: "vy_m_s",
    4: "vn_m_s",
    5: "vt_m_s",
    6: "omega_rad_s",
    7: "sigma_v_m_s",
    8: "sigma_omega_rad_s",
}
