/* The messages of a rig in shared memory and its datagrams, made by `ricochet bindings c`. */
#ifndef RICOCHET_H
#define RICOCHET_H

#include <assert.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define RICOCHET_NUMBER_TYPE_NAME "ricochet.Number.v1"
typedef struct {
    double value;
    uint64_t known;
} ricochet_number_t;
static_assert(sizeof(ricochet_number_t) == 16, "layout");
static_assert(offsetof(ricochet_number_t, known) == 8, "layout");

#define RICOCHET_ESTIMATE_TYPE_NAME "ricochet.Estimate.v1"
typedef struct {
    double value;
    double sigma;
    uint64_t known;
} ricochet_estimate_t;
static_assert(sizeof(ricochet_estimate_t) == 24, "layout");
static_assert(offsetof(ricochet_estimate_t, known) == 16, "layout");

#define RICOCHET_ROD_TYPE_NAME "ricochet.Rod.v1"
typedef struct {
    uint32_t known;
    uint32_t edges;
    uint32_t edge_status[4];
    uint32_t edge_known[4];
    double edge_px[4];
    double sigma_edge_px[4];
    double x_px;
    double sigma_x_px;
    double y_px;
    double sigma_y_px;
    double half_width_px;
    double sigma_half_width_px;
    double tilt_deg;
    double sigma_tilt_deg;
} ricochet_rod_t;
static_assert(sizeof(ricochet_rod_t) == 168, "layout");
static_assert(offsetof(ricochet_rod_t, sigma_tilt_deg) == 160, "layout");

#define RICOCHET_FRAME_HEADER_TYPE_NAME "ricochet.FrameHeader.v1"
typedef struct {
    uint64_t sequence;
    uint64_t stamp_ns;
    uint64_t device_ns;
    uint64_t run_id;
    uint32_t width_px;
    uint32_t height_px;
    uint32_t stride_bytes;
    uint32_t pixel_format;
    uint32_t epoch;
    uint32_t exposure_ns;
    uint32_t shot;
    uint32_t reserved;
} ricochet_frame_header_t;
static_assert(sizeof(ricochet_frame_header_t) == 64, "layout");
static_assert(offsetof(ricochet_frame_header_t, reserved) == 60, "layout");

#define RICOCHET_FIELD_HEADER_TYPE_NAME "ricochet.FieldHeader.v9"
typedef struct {
    uint64_t run_id;
    uint64_t sequence;
    uint64_t target_sequence;
    uint64_t stamp_ns;
    uint32_t body;
    uint32_t interval_frames;
    uint32_t status;
    uint32_t points;
    uint32_t worker;
    uint32_t outline;
    uint32_t method;
    uint32_t exposure_ns;
    uint32_t rotation_status;
    uint32_t skipped_frames;
    double center_x_px;
    double center_y_px;
    double radius_px;
    double sigma_center_px;
    double sigma_radius_px;
    double visible_fraction;
    double rim_fraction;
    double dx_px;
    double dy_px;
    double dtheta_deg;
    double sigma_dx_px;
    double sigma_dy_px;
    double sigma_dtheta_deg;
    ricochet_number_t fixed_fraction;
    ricochet_number_t light_fraction;
    ricochet_number_t pull_px;
    ricochet_number_t growth_fraction;
    double sigma_growth_fraction;
    ricochet_number_t drift_x_px;
    ricochet_number_t drift_y_px;
    double sigma_drift_px;
    ricochet_number_t drift_deg;
    double sigma_drift_deg;
    ricochet_number_t angle_deg;
    double sigma_angle_deg;
    ricochet_rod_t rod;
} ricochet_field_header_t;
static_assert(sizeof(ricochet_field_header_t) == 504, "layout");
static_assert(offsetof(ricochet_field_header_t, rod) == 336, "layout");

#define RICOCHET_FIELD_POINT_TYPE_NAME "ricochet.FieldPoint.v1"
typedef struct {
    float x_px;
    float y_px;
    float u_px;
    float v_px;
    float sigma_u_px;
    float sigma_v_px;
    float zncc;
    float peak_ratio;
    uint32_t status;
} ricochet_field_point_t;
static_assert(sizeof(ricochet_field_point_t) == 36, "layout");
static_assert(offsetof(ricochet_field_point_t, status) == 32, "layout");

#define RICOCHET_TRACK_TYPE_NAME "ricochet.Track.v2"
typedef struct {
    uint64_t run_id;
    uint64_t sequence;
    uint64_t stamp_ns;
    uint32_t body;
    uint32_t status;
    ricochet_number_t center_x_px;
    ricochet_number_t center_y_px;
    ricochet_number_t angle_deg;
    ricochet_number_t radius_px;
    ricochet_number_t sigma_center_px;
    ricochet_number_t sigma_angle_deg;
    ricochet_number_t visible_fraction;
    ricochet_rod_t rod;
} ricochet_track_t;
static_assert(sizeof(ricochet_track_t) == 312, "layout");
static_assert(offsetof(ricochet_track_t, rod) == 144, "layout");

#define RICOCHET_VELOCITY_TYPE_NAME "ricochet.Velocity.v2"
typedef struct {
    uint64_t run_id;
    uint64_t sequence;
    uint64_t stamp_ns;
    uint32_t body;
    uint32_t status;
    uint32_t phase;
    uint32_t rotation_status;
    uint32_t points;
    uint32_t window_frames;
    uint32_t order;
    ricochet_number_t center_x_px;
    ricochet_number_t center_y_px;
    ricochet_number_t radius_px;
    ricochet_number_t dx_px;
    ricochet_number_t dy_px;
    ricochet_number_t dtheta_deg;
    ricochet_number_t sigma_dx_px;
    ricochet_number_t sigma_dy_px;
    ricochet_number_t sigma_dtheta_deg;
    ricochet_number_t vx_m_s;
    ricochet_number_t vy_m_s;
    ricochet_number_t vn_m_s;
    ricochet_number_t vt_m_s;
    ricochet_number_t omega_rad_s;
    ricochet_number_t sigma_v_m_s;
    ricochet_number_t sigma_omega_rad_s;
    ricochet_number_t visible_fraction;
} ricochet_velocity_t;
static_assert(sizeof(ricochet_velocity_t) == 328, "layout");
static_assert(offsetof(ricochet_velocity_t, visible_fraction) == 312, "layout");

#define RICOCHET_VELOCITY_DATAGRAM_TYPE_NAME "ricochet.VelocityDatagram.v1"
typedef struct {
    uint32_t version;
    uint32_t known;
    uint64_t number;
    uint64_t run_id;
    uint64_t sequence;
    uint64_t stamp_ns;
    uint32_t body;
    uint32_t status;
    uint32_t phase;
    uint32_t rotation_status;
    double center_x_px;
    double center_y_px;
    double vx_m_s;
    double vy_m_s;
    double vn_m_s;
    double vt_m_s;
    double omega_rad_s;
    double sigma_v_m_s;
    double sigma_omega_rad_s;
} ricochet_velocity_datagram_t;
static_assert(sizeof(ricochet_velocity_datagram_t) == 128, "layout");
static_assert(offsetof(ricochet_velocity_datagram_t, sigma_omega_rad_s) == 120, "layout");

#define RICOCHET_IMPACT_TYPE_NAME "ricochet.Impact.v4"
typedef struct {
    uint64_t run_id;
    uint64_t origin_ns;
    uint32_t body;
    uint32_t number;
    uint32_t revision;
    uint32_t force_law;
    uint32_t status;
    float force_law_probability;
    ricochet_estimate_t start_s;
    ricochet_estimate_t deepest_s;
    ricochet_estimate_t end_s;
    ricochet_estimate_t vn_before_m_s;
    ricochet_estimate_t vn_after_m_s;
    ricochet_estimate_t vt_before_m_s;
    ricochet_estimate_t vt_after_m_s;
    ricochet_estimate_t omega_before_rad_s;
    ricochet_estimate_t omega_after_rad_s;
    ricochet_estimate_t restitution;
    ricochet_estimate_t restitution_tangential;
    ricochet_estimate_t impulse_ratio;
    ricochet_estimate_t contact_time_s;
    ricochet_estimate_t compression_max_mm;
    ricochet_estimate_t acceleration_max_m_s2;
    ricochet_estimate_t slip_end_s;
    ricochet_estimate_t force_start_s;
    ricochet_estimate_t force_end_s;
    ricochet_estimate_t force_max_n;
    ricochet_estimate_t energy_lost_j;
    ricochet_estimate_t gravity_m_s2;
    ricochet_estimate_t growth_before_per_s;
    ricochet_estimate_t growth_after_per_s;
} ricochet_impact_t;
static_assert(sizeof(ricochet_impact_t) == 592, "layout");
static_assert(offsetof(ricochet_impact_t, growth_after_per_s) == 568, "layout");

#define RICOCHET_EVENT_TYPE_NAME "ricochet.Event.v1"
typedef struct {
    uint64_t run_id;
    uint64_t sequence;
    uint64_t stamp_ns;
    uint32_t kind;
    uint32_t text_bytes;
    uint8_t text[200];
} ricochet_event_t;
static_assert(sizeof(ricochet_event_t) == 232, "layout");
static_assert(offsetof(ricochet_event_t, text) == 32, "layout");

#define RICOCHET_STATUS_TYPE_NAME "ricochet.Status.v2"
typedef struct {
    uint64_t run_id;
    uint32_t role;
    uint32_t index;
    uint32_t pid;
    uint32_t state;
    uint64_t sequence;
    uint64_t stamp_ns;
    uint64_t taken;
    uint64_t given;
    uint64_t lost;
    uint64_t dropped;
    uint64_t restarts;
    uint64_t waiting;
    uint64_t capacity;
    double rate_hz;
    double latency_s;
    double row_latency_median_s;
    double row_latency_p99_s;
    double row_latency_p999_s;
    double row_latency_max_s;
    double row_latency_deviation_s;
} ricochet_status_t;
static_assert(sizeof(ricochet_status_t) == 152, "layout");
static_assert(offsetof(ricochet_status_t, row_latency_deviation_s) == 144, "layout");

#define RICOCHET_PROGRESS_TYPE_NAME "ricochet.Progress.v1"
typedef struct {
    uint64_t run_id;
    uint64_t next_sequence;
    uint32_t role;
    uint32_t index;
    uint32_t done;
    uint32_t reserved;
} ricochet_progress_t;
static_assert(sizeof(ricochet_progress_t) == 32, "layout");
static_assert(offsetof(ricochet_progress_t, reserved) == 28, "layout");

#define RICOCHET_REQUEST_TYPE_NAME "ricochet.Request.v1"
typedef struct {
    uint32_t command;
    uint32_t reserved;
} ricochet_request_t;
static_assert(sizeof(ricochet_request_t) == 8, "layout");
static_assert(offsetof(ricochet_request_t, reserved) == 4, "layout");

#define RICOCHET_REPLY_TYPE_NAME "ricochet.Reply.v1"
typedef struct {
    uint32_t code;
    uint32_t armed;
    uint64_t recordings;
    uint64_t sequence;
} ricochet_reply_t;
static_assert(sizeof(ricochet_reply_t) == 24, "layout");
static_assert(offsetof(ricochet_reply_t, sequence) == 16, "layout");

enum {
    RICOCHET_STATUS_VALID = 0,
    RICOCHET_STATUS_LOW_CONTRAST = 1,
    RICOCHET_STATUS_LOW_CORRELATION = 2,
    RICOCHET_STATUS_AMBIGUOUS = 3,
    RICOCHET_STATUS_OUTLIER = 4,
    RICOCHET_STATUS_OCCLUDED = 5,
    RICOCHET_STATUS_OUT_OF_FRAME = 6,
    RICOCHET_STATUS_LOST = 7,
    RICOCHET_STATUS_PREDICTED = 8,
};

enum {
    RICOCHET_PHASE_UNKNOWN = 0,
    RICOCHET_PHASE_FLIGHT = 1,
    RICOCHET_PHASE_CONTACT = 2,
    RICOCHET_PHASE_REBOUND = 3,
};

enum {
    RICOCHET_EVENT_PREPARED = 1,
    RICOCHET_EVENT_STARTED = 2,
    RICOCHET_EVENT_ENDED = 3,
    RICOCHET_EVENT_ARMED = 4,
    RICOCHET_EVENT_DISARMED = 5,
    RICOCHET_EVENT_TRIGGERED = 6,
    RICOCHET_EVENT_RECORDED = 7,
    RICOCHET_EVENT_LOST = 8,
    RICOCHET_EVENT_RESTARTED = 9,
    RICOCHET_EVENT_CAMERA = 10,
    RICOCHET_EVENT_TRACKED = 11,
    RICOCHET_EVENT_STORAGE = 12,
    RICOCHET_EVENT_DECIDED = 13,
    RICOCHET_EVENT_STATE = 14,
    RICOCHET_EVENT_ACTION = 15,
    RICOCHET_EVENT_CONTACT = 16,
    RICOCHET_EVENT_DEEPEST = 17,
    RICOCHET_EVENT_WITHDRAWN = 18,
    RICOCHET_EVENT_MATCHED = 19,
    RICOCHET_EVENT_SILENT = 20,
    RICOCHET_EVENT_HUNG = 21,
    RICOCHET_EVENT_BEHIND = 22,
    RICOCHET_EVENT_REMEASURED = 23,
};

enum {
    RICOCHET_FORCE_LAW_NONE = 0,
    RICOCHET_FORCE_LAW_KELVIN_VOIGT = 1,
    RICOCHET_FORCE_LAW_HUNT_CROSSLEY = 2,
    RICOCHET_FORCE_LAW_POWER_LAW = 3,
};

enum {
    RICOCHET_ROLE_ACQUIRE = 1,
    RICOCHET_ROLE_CORRELATE = 2,
    RICOCHET_ROLE_TRACK = 3,
    RICOCHET_ROLE_RECORD = 4,
    RICOCHET_ROLE_RUN = 5,
    RICOCHET_ROLE_SERVE = 6,
};

enum {
    RICOCHET_BODY_KIND_BALL = 0,
    RICOCHET_BODY_KIND_ROD = 1,
    RICOCHET_BODY_KIND_PATCH = 2,
};

enum {
    RICOCHET_DATAGRAM_BIT_CENTER_X_PX = 0,
    RICOCHET_DATAGRAM_BIT_CENTER_Y_PX = 1,
    RICOCHET_DATAGRAM_BIT_VX_M_S = 2,
    RICOCHET_DATAGRAM_BIT_VY_M_S = 3,
    RICOCHET_DATAGRAM_BIT_VN_M_S = 4,
    RICOCHET_DATAGRAM_BIT_VT_M_S = 5,
    RICOCHET_DATAGRAM_BIT_OMEGA_RAD_S = 6,
    RICOCHET_DATAGRAM_BIT_SIGMA_V_M_S = 7,
    RICOCHET_DATAGRAM_BIT_SIGMA_OMEGA_RAD_S = 8,
};

#ifdef __cplusplus
}
#endif

#endif
