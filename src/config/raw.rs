//! The rig file as it is written: names and types only, nothing checked.
//!
//! Every key is optional here, and numbers are as wide as in TOML. The next stage, which has the ranges, words every error.
//!
//! Each key is described here once, with the values that it allows and its default. [`reference()`](super::reference()) is
//! made from these descriptions.

use super::key::{Key, Section, TomlType};
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The whole file.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "tables")]
pub(super) struct RawConfig {
    pub rig: RawRig,
    pub camera: RawCamera,
    pub scale: RawScale,
    pub surface: RawSurface,
    pub calibration: Option<RawCalibration>,
    pub body: Vec<RawBody>,
    pub correlation: RawCorrelation,
    pub rotation: RawRotation,
    pub velocity: RawVelocity,
    pub trigger: RawTrigger,
    pub record: Option<RawRecord>,
    pub workers: RawWorkers,
    pub view: BTreeMap<String, RawView>,
    pub serve: Option<RawServe>,
    pub bridge: Option<RawBridge>,
}

/// The tables of one camera and its image.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "tables")]
pub(super) struct RawView {
    pub camera: RawCamera,
    pub scale: RawScale,
    pub surface: RawSurface,
    pub calibration: Option<RawCalibration>,
    pub body: Vec<RawBody>,
    pub correlation: RawCorrelation,
    pub rotation: RawRotation,
    pub velocity: RawVelocity,
}

/// One number or a list.
#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "a whole number or a list of them")]
pub(super) enum OneOrMore {
    One(i64),
    More(Vec<i64>),
}

impl TomlType for OneOrMore {
    const NAME: &'static str = "whole number or list";

    fn schema() -> Value {
        json!({ "oneOf": [{ "type": "integer" }, { "type": "array", "items": { "type": "integer" } }] })
    }
}

/// Defines tables whose keys are all optional, and [`SECTIONS`], their descriptions.
///
/// `#[key(allowed, default)]` completes the sentence "must be ...", and names the value of an absent key.
macro_rules! tables {
    ($(
        $(#[doc = $about:literal])*
        $path:literal $table:ident {
            $($(#[doc = $meaning:literal])* #[key($allowed:literal, $default:literal)] $key:ident: $type:ty,)*
        }
    )*) => {
        $(
            #[derive(Debug, Default, Deserialize)]
            #[serde(deny_unknown_fields, default, expecting = "a table")]
            pub(super) struct $table { $(pub $key: Option<$type>,)* }
        )*

        /// The tables of the rig file, described.
        pub(super) const SECTIONS: &[Section] = &[$(Section {
            path: $path,
            about: concat!($($about, "\n",)*),
            keys: &[$(Key {
                name: stringify!($key),
                value: <$type as TomlType>::NAME,
                schema: <$type as TomlType>::schema,
                allowed: $allowed,
                default: $default,
                meaning: concat!($($meaning, "\n",)*),
            },)*],
        },)*];
    };
}

tables! {
    /// The rig.
    "rig" RawRig {
        /// The name in shared memory. Two rigs of one user need different names.
        #[key("1 to 32 of the characters a-z 0-9 _ -", "rig")]
        name: String,
    }
    /// The source of the frames, and their properties. A file for films that are measured offline needs no source, and
    /// has at most the keys `exposure_us`, `gamma`, `row_time_us` and `defective_px`.
    "camera" RawCamera {
        /// The source: a drawn scenario with known truth, a recording, a GigE Vision or USB3 Vision camera, or a camera
        /// of the Linux kernel. Required by a rig that runs.
        #[key("\"simulated\", \"recording\", \"genicam\", \"v4l2\"", "none")]
        source: String,
        /// The camera or file. `genicam`: an address, serial number or device name. `v4l2`: a device file, or the
        /// place, serial number or name of a camera. `recording`: the path of an MCAP file, which starts at the working
        /// directory if it is relative.
        #[key("a text of one line that is not empty", "required by all sources but simulated")]
        id: String,
        /// The simulation: the name of a built-in scenario, or the path of a scenario file. For `simulated` only.
        #[key("a text of one line that is not empty", "lacrosse")]
        scenario: String,
        /// Whether frames come in real time. If false, they come as fast as the rig measures, and none is lost. The
        /// results are the same. For `simulated` and `recording`.
        #[key("true or false", "true")]
        paced: bool,
        /// Whether the whole film is drawn before the start, and then played forwards and backwards in turn until the rig
        /// is stopped. Timestamps are those of the present, and there is no truth. For `simulated` and paced only.
        #[key("true or false", "false")]
        endless: bool,
        /// The speed of a paced `recording`.
        #[key("0.001 to 1000 times real time", "1")]
        playback_rate: f64,
        /// The start of playing a `recording`, from its first frame.
        #[key("0 to 1000000 s", "0")]
        from_s: f64,
        /// The end of playing a `recording`, from its first frame, above `from_s`. Its frame is not played.
        #[key("above 0 and at most 1000000 s", "the end of the recording")]
        to_s: f64,
        /// Further recordings of the stream that `id` begins, in order of time. For `recording` only.
        #[key("a list of texts", "none")]
        parts: Vec<String>,
        /// The camera within a `recording`, by the name of its view.
        #[key("a text of one line that is not empty", "the first camera")]
        view: String,
        /// A time added to the timestamp of every frame of a `recording`, ns.
        #[key("a whole number", "0")]
        shift_ns: i64,
        /// Whether each frame of a `recording` waits for a line on standard input. The stream ends with the input.
        /// `paced` and `playback_rate` are then unused.
        #[key("true or false", "false")]
        stepped: bool,
        /// The number of pixels per row. A recording has its own.
        #[key("16 to 65535 px", "required by genicam and v4l2; simulated: that of the scenario")]
        width_px: i64,
        /// The number of rows.
        #[key("16 to 65535 px", "required by genicam and v4l2; simulated: that of the scenario")]
        height_px: i64,
        /// The left edge of the window that is read from the sensor. For `genicam` only.
        #[key("0 to 65535 px", "the camera's own")]
        offset_x_px: i64,
        /// The upper edge of the window that is read from the sensor. For `genicam` only.
        #[key("0 to 65535 px", "the camera's own")]
        offset_y_px: i64,
        /// The pixel layout. A recording has its own.
        #[key("\"Mono8\", \"Mono10\", \"Mono12\", \"Mono16\"", "Mono8; simulated: that of the scenario")]
        pixel_format: String,
        /// The frames per second. With `trigger_source` it is the maximum expected rate of triggers. A `v4l2` driver
        /// that cannot set a rate delivers at its own, and this is the rate that the rig expects.
        #[key("above 0 and at most 1000000 Hz", "required by genicam and v4l2; simulated: that of the scenario")]
        frame_rate_hz: f64,
        /// The exposure time, at most the duration of a frame. `v4l2` has steps of 100 us.
        #[key("above 0 and at most 10000000 us", "that of the camera or scenario")]
        exposure_us: f64,
        /// The exponent of the tone curve of the camera. Its grey levels are the light to this power, and the light is
        /// measured. Machine-vision cameras have no tone curve; those made for viewing have about 0.45.
        #[key("0.2 to 5", "1")]
        gamma: f64,
        /// The row time of a rolling shutter: the delay of each row to the one above it, below 0 if the shutter rolls
        /// upwards. All rows lie within the duration of a frame. Without the correction, vertical speeds are wrong by
        /// it.
        #[key("-1000 to 1000 us", "0, all rows at once")]
        row_time_us: f64,
        /// The hot and dead pixels, within the image. `ricochet check` finds them. For measuring they are filled in
        /// from their neighbours. Recordings keep the pixels that the camera delivered.
        #[key("at most 10000 pairs of column and row, each 0 to 65534", "none")]
        defective_px: Vec<Vec<i64>>,
        /// The trigger of each frame, by its GenICam name, such as `Line1` or `Software`. For `genicam` only.
        #[key("a text of one line that is not empty", "the camera runs freely")]
        trigger_source: String,
        /// The time between the pulses of a simulated trigger line. For `simulated` and paced only.
        #[key("0.001 to 3600 s", "the camera runs freely")]
        pulse_period_s: f64,
        /// The number of frames of each pulse.
        #[key("1 to 1000000 frames", "1")]
        pulse_frames: i64,
        /// The maximum network packet. For `genicam` over Ethernet only.
        #[key("576 to 65535 bytes", "as large as network card and camera allow")]
        packet_size_bytes: i64,
        /// Any other feature of the camera. `genicam`: by its GenICam name, or `Name[Selector=Word]` behind a selector.
        /// `v4l2`: any control of the driver by its name, in lower case with `_`. The order does not matter: a feature
        /// that the camera refuses at first is tried again after the others.
        #[key("a table of true or false, finite numbers and texts in quotes", "none")]
        features: BTreeMap<String, toml::Value>,
    }
    /// The size of a pixel. Without it, results are in pixels only.
    "scale" RawScale {
        /// The size of a pixel in the plane of motion.
        #[key("0.000001 to 1000 mm/px", "unknown")]
        mm_per_px: f64,
        /// The true diameter of the ball. The scale follows from its measured radius. In place of `mm_per_px`.
        #[key("above 0 and at most 10000 mm", "unknown")]
        ball_diameter_mm: f64,
    }
    /// The lens of the camera, the plane of motion, or both. Without it, a pixel has the same size everywhere.
    "calibration" RawCalibration {
        /// A file with the numbers below: OpenCV YAML or JSON, ROS camera_info or foxglove.CameraCalibration.
        /// Recordings contain its numbers, and keys of the rig file take precedence.
        #[key("the path of a file", "none")]
        file: String,
        /// Width and height of the calibrated image.
        #[key("[x, y], each 16 to 65535 px", "required")]
        image_px: Vec<i64>,
        /// The place of the recorded image in the calibrated one.
        #[key("[x, y], each 0 to 65535 px", "camera.offset_x_px and camera.offset_y_px")]
        offset_px: Vec<i64>,
        /// The camera matrix, row by row.
        #[key("[fx, 0, cx, 0, fy, cy, 0, 0, 1] with focal lengths of 1 to 1000000 px", "no lens")]
        camera_matrix: Vec<f64>,
        /// The model of the distortion, as OpenCV, ROS and Foxglove name it.
        #[key("\"plumb_bob\", \"rational_polynomial\", \"equidistant\", \"fisheye\", \"kannala_brandt\"", "plumb_bob")]
        distortion_model: String,
        /// The coefficients of the distortion: k1, k2, p1, p2, k3, k4, k5, k6 of the Brown model, or k1 to k4 of an
        /// equidistant one.
        #[key("at most 8 finite numbers", "none")]
        distortion: Vec<f64>,
        /// The map from undistorted pixels to mm in the plane of motion. It gives the scale.
        #[key("3 x 3 finite numbers, row by row", "no plane")]
        homography_mm: Vec<f64>,
    }
    /// The surface that bodies strike.
    "surface" RawSurface {
        /// The direction of the tangent in the image, counter-clockwise from x. The outward normal is a quarter turn
        /// further counter-clockwise.
        #[key("-180 to 180 deg", "the direction of edge, else 0: level, with the body above")]
        angle_deg: f64,
        /// Two points of the edge that bodies touch, within 2 deg of `angle_deg`. Triggers on the gap or a predicted
        /// contact need it. A contact counts only between the points.
        #[key("two points [[x, y], [x, y]] in px, -65535 to 65535, at least 1 px apart", "unknown")]
        edge: Vec<Vec<f64>>,
        /// The body that is the surface, if it moves, such as a racket with a speckled patch near the point of contact. The
        /// velocities, restitution and energy of an impact are then relative to it.
        #[key("the name of a [[body]] that others strike", "none: the surface is fixed")]
        body: String,
    }
    /// A body to follow, 1 to 16 of them. A file without any has a ball named `ball`.
    "body" RawBody {
        /// The name in results, different for each body.
        #[key("1 to 32 of the characters a-z A-Z 0-9 _ -", "the kind, if there is only one body")]
        name: String,
        /// The kind of body.
        #[key("\"ball\", \"rod\", \"patch\"", "ball")]
        kind: String,
        /// The true diameter. With `scale.mm_per_px` it narrows the range of radii (or widths) to search. With
        /// `scale.ball_diameter_mm` it replaces that value for this body.
        #[key("above 0 and at most 10000 mm", "unknown")]
        diameter_mm: f64,
        /// The mass. It converts accelerations to forces and speeds to energies.
        #[key("above 0 and at most 1000 kg", "unknown")]
        mass_kg: f64,
        /// The minimum radius of a ball to search, less than `max_radius_px`. Below 6 px it is followed as a point.
        #[key(
            "2 to 32768 px",
            "0.8 times the radius that diameter and scale predict, else 0.04 of the smaller side of the image"
        )]
        min_radius_px: f64,
        /// The maximum radius of a ball to search.
        #[key("2 to 32768 px", "1.25 times the predicted radius, else 0.45 of the smaller side of the image")]
        max_radius_px: f64,
        /// The method for the outline of a ball: `edges`, accurate to a few hundredths of a pixel, or `marked`, the
        /// marked boundary and Hough transform of the paper, accurate to some tenths.
        #[key("\"edges\", \"marked\"", "edges")]
        outline: String,
        /// The number of tape edges to follow on a rod, from the top. A rod is found if all of them are visible.
        #[key("2 to 4", "4")]
        edges: i64,
        /// The distance from the lowest followed edge down to the end of a rod. Triggers on its gap or its predicted
        /// contact need it, and `scale.mm_per_px`.
        #[key("0 to 10000 mm", "unknown")]
        end_mm: f64,
        /// The region to search, inside the image.
        #[key("[x, y, width, height] inside an image of at most 65535 x 65535 px", "the whole image")]
        roi_px: Vec<i64>,
        /// The corners of a patch in the first frame of the stream.
        #[key("3 to 256 corners [x, y], 0 to 65535 and 0 to 65535 px", "required by patch")]
        polygon_px: Vec<Vec<f64>>,
        /// Polygons within a patch that do not belong to it.
        #[key("polygons, each 3 to 256 corners [x, y], 0 to 65535 and 0 to 65535 px", "none")]
        holes_px: Vec<Vec<Vec<f64>>>,
        /// The reported point of a patch.
        #[key("a point [x, y] in px, -65535 to 65535", "the centroid")]
        center_px: Vec<f64>,
    }
    /// The measurement of displacements. The correlator decides which methods, shapes and windows can be combined.
    "correlation" RawCorrelation {
        /// The method: cross-correlation of spline-interpolated subsets (the method of the paper), a Gaussian or spline
        /// fit of the correlation peak, or inverse-compositional Gauss-Newton.
        #[key("\"spline-fft\", \"peak-gaussian\", \"peak-spline\", \"ic-gn\"", "ic-gn")]
        method: String,
        /// The shape function of `ic-gn`.
        #[key("\"translation\", \"rigid\", \"affine\", \"quadratic\"", "affine")]
        shape: String,
        /// The outline of a subset.
        #[key("\"square\", \"circle\", \"ring\"", "square")]
        window: String,
        /// The full width of a subset.
        #[key("9 to 255 px, odd", "31")]
        subset_size_px: i64,
        /// The distance between the centres of subsets.
        #[key("1 to 255 px", "10")]
        step_px: i64,
        /// The number of spline points between two pixels. For `spline-fft` only.
        #[key("0 to 20", "2")]
        spline_points: i64,
        /// The largest displacement that is searched without an initial guess.
        #[key("1 to 1024 px", "16")]
        search_px: i64,
        /// The intervals from reference to target. Longer ones keep the sum of the steps of the first from drifting.
        #[key("1 to 255 frames, or a rising list of at most 4 such numbers", "1")]
        interval_frames: OneOrMore,
        /// The minimum zero-mean normalised cross-correlation of an accepted match.
        #[key("0 to 1", "0.7")]
        min_zncc: f64,
        /// The interpolation of the target.
        #[key("\"optimised\", \"bicubic\"", "optimised")]
        interpolation: String,
    }
    /// The source of motion and spin of balls. The motion of a rod always comes from its subsets.
    "rotation" RawRotation {
        /// The method: the whole disc as one rigid body, the field of subsets, the centre of the outline alone, or a
        /// polar ring. If all bodies are rods, only `field` is accepted.
        #[key("\"rigid\", \"field\", \"center\", \"ring\"", "rigid")]
        method: String,
        /// The inner radius of the ring.
        #[key("1 to 32768 px", "0.35 of the radius")]
        ring_inner_px: f64,
        /// The outer radius of the ring, at least 4 px more than the inner.
        #[key("1 to 32768 px", "0.96 of the radius")]
        ring_outer_px: f64,
    }
    /// The fit of velocities to positions.
    "velocity" RawVelocity {
        /// The number of frames of the local fit, more than `order`.
        #[key("3 to 1001 frames, odd", "chosen by the fit")]
        window_frames: i64,
        /// The number of later frames that a velocity waits for and is fitted to. A few give a controller early rows, which
        /// are ten times less certain and have a later `phase`.
        #[key("0 to 2 frames", "20, or half of window_frames if that is more")]
        lag_frames: i64,
        /// The order of the polynomial fitted to the positions.
        #[key("1 to 4", "2")]
        order: i64,
        /// The acceleration of gravity; 0 switches it off.
        #[key("0 to 100 m/s^2", "9.80665")]
        gravity_m_s2: f64,
        /// The direction of gravity, counter-clockwise from x (y up): -90 - t for a camera tilted by t counter-clockwise.
        #[key("-180 to 180 deg", "-90, a level camera")]
        gravity_angle_deg: f64,
    }
    /// The start of a shot, its length, and further actions. `ricochet trigger` starts a shot in every mode but `off`
    /// and `hardware`.
    "trigger" RawTrigger {
        /// The condition that starts a shot. `off`: none, and the whole stream becomes one recording. `software`: a
        /// request. `hardware`: the line of the camera. `motion`: grey levels change. `enter`: a body enters `roi_px`.
        /// `speed`: a body exceeds `speed_m_s`. `gap`: the gap to the surface falls below `gap_mm`.
        /// `predicted-contact`: a body is about to touch the surface.
        #[key("\"off\", \"software\", \"hardware\", \"motion\", \"enter\", \"speed\", \"gap\", \"predicted-contact\"", "off")]
        mode: String,
        /// The mean absolute change of the grey levels in `roi_px` from one frame to the next that counts as motion.
        /// Noise of standard deviation s alone gives 1.13 s. For mode `motion`.
        #[key("above 0 and at most 65535 DN", "5")]
        threshold_dn: f64,
        /// The watched region of the image: of its grey levels (mode `motion`) or for a body's centre (mode `enter`).
        #[key("[x, y, width, height] inside an image of at most 65535 x 65535 px", "the whole image")]
        roi_px: Vec<i64>,
        /// The body that may start a shot. For the modes `enter`, `speed`, `gap` and `predicted-contact`.
        #[key("the name of a body", "every body")]
        body: String,
        /// The speed to exceed. It needs a `[scale]`.
        #[key("above 0 and at most 100000 m/s", "required by mode speed")]
        speed_m_s: f64,
        /// The gap between the rim of the ball, or the end of the rod, and `surface.edge`. It needs a `[scale]`.
        #[key("0 to 100000 mm", "required by mode gap")]
        gap_mm: f64,
        /// The maximum time from the prediction to the contact. The prediction comes later if the moment of contact is
        /// not known to half a frame that early, and at the contact if it cannot be known before. For mode
        /// `predicted-contact`, which needs a `[scale]`.
        #[key("0 to 10 s", "0.01")]
        lead_s: f64,
        /// The silence of the camera that ends a shot. The next frame begins another shot. For mode `hardware`.
        #[key("0.01 to 3600 s", "0.2")]
        silence_s: f64,
        /// The time recorded before the trigger. The ring of frames must hold it. Not for mode `hardware`.
        #[key("0 to 60 s", "0.05")]
        pre_s: f64,
        /// The time recorded from the trigger on. Not for mode `hardware`.
        #[key("above 0 and at most 3600 s", "0.1")]
        post_s: f64,
        /// The minimum time between triggers. Earlier ones are ignored, except `ricochet trigger`.
        #[key("0 to 86400 s", "0")]
        quiet_s: f64,
        /// Whether the rig arms itself again after a shot. Otherwise it waits for `ricochet arm`.
        #[key("true or false", "true")]
        rearm: bool,
        /// The program to run at each trigger. No shell is involved.
        #[key("a program and its arguments, 1 to 64 texts", "none")]
        command: Vec<String>,
        /// The address of a web service that receives a POST at each trigger.
        #[key("http[s]://host[:port][/path]", "none")]
        url: String,
        /// The name of another rig on this machine to trigger as well.
        #[key("a text of one line that is not empty", "none")]
        other_rig: String,
    }
    /// The recordings. Without this table nothing is recorded.
    "record" RawRecord {
        /// The folder of the recordings, created if missing. A relative path starts at the working directory.
        #[key("the path of a folder", "required")]
        directory: String,
        /// The compression of the frames. `zstd` makes noisy images a quarter smaller and takes several times longer.
        #[key("\"none\", \"zstd\"", "none")]
        compression: String,
        /// Whether the frames are kept. If false, the recording has results only and cannot be analysed again.
        #[key("true or false", "true")]
        raw_frames: bool,
        /// The maximum size of the ring of frames in memory. It must hold `trigger.pre_s`.
        #[key("1048576 to 1099511627776 bytes", "limited by the memory of the machine only")]
        ring_bytes_max: i64,
        /// The number of finished recordings of this rig to keep in the folder. The oldest are deleted first.
        #[key("1 to 1000000 recordings", "all")]
        keep_last: i64,
        /// The maximum total size of the recordings of this rig in the folder, including the one being written. The
        /// oldest are deleted until the rest fits, but never the newest finished one. Other files, results of `analyze`
        /// and unfinished recordings are never deleted and do not count.
        #[key("1048576 to 1125899906842624 bytes", "limited by the disk only")]
        max_bytes: i64,
        /// The maximum size of one file. A larger recording `NAME.mcap` continues in `NAME_0001.mcap` and so on. Each
        /// file is complete by itself. They count as one recording.
        #[key("1048576 to 1125899906842624 bytes", "one file")]
        split_bytes: i64,
    }
    /// The division of the work.
    "workers" RawWorkers {
        /// The number of correlation processes. Results do not depend on it. With 0, frames are not measured.
        #[key("0 to 64", "one less than the machine has processors, but two if it has two")]
        count: i64,
        /// The number of frames that a worker measures together, as a block on its own. Results depend on it.
        #[key("4 to 256 frames", "64")]
        block_frames: i64,
        /// The aim of the processes: the most frames per second, or the shortest time from a frame to its row. Results do not
        /// depend on it. For `latency`, each worker keeps a processor of its own, and all look for work every 50 us.
        #[key("\"throughput\", \"latency\"", "throughput")]
        mode: String,
    }
    /// The page of the operator and the streams of topics, which `run` and `serve` offer.
    "serve" RawServe {
        /// The address of page and streams. Port 0 takes a free one. `off` serves nothing. If the address is taken, `run`
        /// prints a warning and films without a page.
        #[key("\"off\", or an address and a port, such as \"127.0.0.1:8080\"", "127.0.0.1:8080")]
        http: String,
        /// The address for Foxglove viewers. Pages of any site that is open in a browser of this computer can reach it
        /// too, so leave it off where that matters. Other computers reach it through an SSH tunnel.
        #[key("\"off\", or an address of this computer and a port, such as \"127.0.0.1:8765\"", "off")]
        foxglove: String,
        /// The MQTT broker that `ricochet/RIG/velocity`, `impact`, `events` and `status` are published at.
        #[key("\"off\", or the host and the port of a broker, such as \"broker.local:1883\"", "off")]
        mqtt: String,
        /// The name of the user at the MQTT broker.
        #[key("a text of one line that is not empty", "none: the broker asks for no name")]
        mqtt_user: String,
        /// The file whose first line is the password of `mqtt_user`. The rig file itself is in every recording.
        #[key("a text of one line that is not empty", "none: no password")]
        mqtt_password_file: String,
        /// The file with the certificates (PEM) of those that may sign the broker's certificate. With it, the connection
        /// is encrypted by TLS, and the broker must have a certificate for its name in `mqtt`.
        #[key("a text of one line that is not empty", "none: the connection is not encrypted")]
        mqtt_ca_file: String,
        /// The address that each velocity is sent to as a UDP datagram: of a controller, a broadcast or a multicast group.
        #[key("\"off\", or an address and a port, such as \"192.168.1.20:5005\"", "off")]
        udp: String,
        /// The file whose first line is the token that every request must carry, 16 to 256 printable characters without
        /// blanks. The token has a file of its own because the rig file is attached to every recording.
        #[key("a text of one line that is not empty", "required if other computers reach http")]
        token_file: String,
    }
    /// The topics for other hosts, which `ricochet bridge` publishes if it is built with the feature `zenoh`.
    "bridge" RawBridge {
        /// The Zenoh endpoint to listen at, or the path of a file of Zenoh's configuration, with routers, TLS and users.
        #[key("\"off\", an endpoint such as \"tcp/127.0.0.1:7447\", or a path that ends in .json5", "off")]
        zenoh: String,
        /// Whether other hosts may arm, disarm and trigger the rig.
        #[key("true or false", "false")]
        control: bool,
    }
}
