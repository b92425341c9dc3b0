//! Who may name whom, bottom to top.

/// One room of src/.
pub struct Room {
    /// Folder or file under src/.
    pub name: &'static str,
    /// Rooms it may name besides itself, all below it.
    pub rooms: &'static [&'static str],
    /// Outside crates it may name.
    pub crates: &'static [&'static str],
    /// No clock, no file, no thread, no environment.
    pub pure: bool,
}

const fn pure(name: &'static str, rooms: &'static [&'static str], crates: &'static [&'static str]) -> Room {
    Room { name, rooms, crates, pure: true }
}

const fn open(name: &'static str, rooms: &'static [&'static str], crates: &'static [&'static str]) -> Room {
    Room { name, rooms, crates, pure: false }
}

const BELOW_PROCESS: &[&str] = &[
    "failure",
    "interrupt",
    "input",
    "results",
    "image",
    "numeric",
    "dic",
    "ball",
    "rod",
    "motion",
    "trigger",
    "impact",
    "measure",
    "track",
    "synth",
    "config",
    "message",
    "recording",
    "import",
    "camera",
    "bus",
];
const BELOW_COMMAND: &[&str] = &[
    "failure",
    "interrupt",
    "input",
    "results",
    "image",
    "numeric",
    "dic",
    "ball",
    "rod",
    "motion",
    "survey",
    "trigger",
    "impact",
    "measure",
    "track",
    "synth",
    "config",
    "message",
    "recording",
    "plot",
    "report",
    "import",
    "camera",
    "bus",
    "process",
    "serve",
    "console",
];

const BELOW_STUDY: &[&str] = &[
    "failure",
    "interrupt",
    "input",
    "results",
    "image",
    "numeric",
    "dic",
    "ball",
    "rod",
    "motion",
    "trigger",
    "impact",
    "measure",
    "track",
    "synth",
    "config",
    "message",
    "recording",
    "plot",
    "report",
    "import",
    "camera",
    "bus",
    "process",
    "serve",
    "console",
    "command",
];

/// The rooms in the order of src/lib.rs.
pub const ROOMS: &[Room] = &[
    open("failure", &[], &["thiserror"]),
    open("interrupt", &["failure"], &["rustix", "signal_hook", "thiserror"]),
    open("input", &[], &[]),
    pure("results", &[], &[]),
    pure("image", &["failure", "results"], &["image", "multiversion", "thiserror"]),
    pure("numeric", &["results"], &["multiversion", "nalgebra", "rustfft"]),
    pure(
        "dic",
        &["failure", "results", "image", "numeric"],
        &["libm", "multiversion", "nalgebra", "realfft", "thiserror"],
    ),
    pure("ball", &["failure", "results", "image", "numeric"], &["multiversion", "nalgebra", "thiserror"]),
    pure("rod", &["failure", "results", "image", "numeric"], &["multiversion", "nalgebra", "thiserror"]),
    pure("motion", &["results", "numeric"], &["nalgebra", "thiserror"]),
    pure("survey", &["results", "image", "numeric", "ball", "rod"], &[]),
    pure("trigger", &["results", "image", "motion"], &[]),
    pure("impact", &["results", "numeric", "motion"], &["libm", "multiversion", "nalgebra", "thiserror"]),
    pure(
        "measure",
        &["failure", "results", "image", "numeric", "dic", "ball", "rod", "motion", "impact"],
        &["nalgebra", "thiserror"],
    ),
    pure("track", &["results", "motion", "impact", "measure"], &["nalgebra"]),
    pure("synth", &["failure", "results", "image", "numeric", "motion"], &["nalgebra", "serde", "thiserror", "toml"]),
    open(
        "config",
        &["failure", "results", "image", "dic", "ball", "rod", "motion", "trigger"],
        &["serde", "serde_json", "thiserror", "toml", "toml_edit"],
    ),
    open("message", &["results", "image"], &["thiserror"]),
    open(
        "recording",
        &["failure", "interrupt", "input", "results", "image", "config", "message"],
        &[
            "bytes",
            "crc32fast",
            "foxglove",
            "image",
            "log",
            "lz4",
            "prost",
            "prost_types",
            "rustix",
            "serde",
            "serde_json",
            "thiserror",
            "zstd",
        ],
    ),
    pure("plot", &["results", "image"], &["image", "maud"]),
    open("report", &["results", "image", "numeric", "recording", "plot"], &["base64", "chrono", "image", "maud"]),
    open(
        "import",
        &["failure", "interrupt", "input", "image", "numeric"],
        &["chrono", "glob", "image", "serde_json", "thiserror", "tiff"],
    ),
    open(
        "camera",
        &["failure", "results", "image", "synth", "config", "message", "recording"],
        &["bytes", "libc", "libloading", "log", "rustix", "thiserror", "zune_jpeg"],
    ),
    open(
        "bus",
        &["failure", "results", "image", "config", "message", "camera"],
        &["iceoryx2", "log", "rustix", "thiserror"],
    ),
    open("process", BELOW_PROCESS, &["chrono", "log", "rustix", "serde_json", "thiserror", "ureq"]),
    open(
        "serve",
        &["failure", "results", "image", "config", "message", "recording", "plot", "report", "bus", "process"],
        &[
            "axum",
            "foxglove",
            "futures_util",
            "hyper",
            "hyper_util",
            "image",
            "log",
            "maud",
            "rumqttc",
            "rustix",
            "serde_json",
            "thiserror",
            "tokio",
            "toml",
        ],
    ),
    open("console", &["failure", "interrupt", "process"], &["clap", "csv", "indicatif", "serde_json", "thiserror"]),
    open(
        "command",
        BELOW_COMMAND,
        &[
            "clap",
            "clap_complete",
            "clap_mangen",
            "crc32fast",
            "csv",
            "env_logger",
            "image",
            "indicatif",
            "libc",
            "libm",
            "log",
            "parquet",
            "rustix",
            "serde",
            "serde_json",
            "signal_hook",
            "thiserror",
            "toml",
            "toml_edit",
            "zenoh",
            "zenoh_ext",
        ],
    ),
    open(
        "study",
        BELOW_STUDY,
        &[
            "clap",
            "csv",
            "image",
            "libm",
            "log",
            "maud",
            "nalgebra",
            "realfft",
            "serde",
            "serde_json",
            "thiserror",
            "toml",
        ],
    ),
    open(
        "cli",
        &["failure", "dic", "config", "message", "plot", "process", "command", "console", "study"],
        &["clap", "clap_complete", "log"],
    ),
];

/// What src/main.rs may name of the outside; of the rooms it may name all.
pub const MAIN_CRATES: &[&str] = &["env_logger", "log", "signal_hook"];

/// Single names a room may take from a crate that is otherwise closed to it.
///
/// A message is marked as safe to share where it is defined, by a derive; the marker is all it knows of the bus.
pub const SINGLE_NAMES: &[(&str, &str)] = &[("message", "iceoryx2::prelude::ZeroCopySend")];

/// The dependencies, as they are spelled in the source; `mcap` is what the tests hold our files against.
pub const OUTSIDE: &[&str] = &[
    "axum",
    "base64",
    "bytes",
    "chrono",
    "clap",
    "clap_complete",
    "clap_mangen",
    "crc32fast",
    "csv",
    "env_logger",
    "foxglove",
    "futures_util",
    "glob",
    "hyper",
    "hyper_util",
    "iceoryx2",
    "image",
    "indicatif",
    "libc",
    "libloading",
    "libm",
    "log",
    "lz4",
    "maud",
    "mcap",
    "multiversion",
    "nalgebra",
    "parquet",
    "prost",
    "prost_types",
    "realfft",
    "rumqttc",
    "rustfft",
    "rustix",
    "serde",
    "serde_json",
    "signal_hook",
    "thiserror",
    "tiff",
    "tokio",
    "toml",
    "toml_edit",
    "ureq",
    "zenoh",
    "zenoh_ext",
    "zstd",
    "zune_jpeg",
];

/// What a pure room may not name of the standard library.
pub const IMPURE: &[&str] = &[
    "std::env",
    "std::fs",
    "std::io",
    "std::net",
    "std::os",
    "std::process",
    "std::thread",
    "std::time::Instant",
    "std::time::SystemTime",
];

/// Rooms whose unsafe blocks are shared memory and C libraries.
pub const UNSAFE_ROOMS: &[&str] = &["camera", "bus"];

/// The one file elsewhere with unsafe blocks: vector instructions, chosen at run time, on arrays of fixed size.
pub const UNSAFE_FILE: &str = "src/numeric/vector.rs";

/// Rooms whose public numbers carry their unit in their name.
pub const UNIT_ROOMS: &[&str] = &["results", "message", "config"];

/// Endings of numbers that have a unit.
pub const UNITS: &[&str] = &[
    "_px",
    "_mm",
    "_m_s",
    "_m_s2",
    "_kg",
    "_rad_s",
    "_deg",
    "_s",
    "_ms",
    "_us",
    "_ns",
    "_hz",
    "_dn",
    "_bytes",
    "_frames",
    "_fraction",
    "_bytes_max",
];

/// Numbers that count, name, switch or compare something, and the key `surface.edge`, whose name is settled.
pub const DIMENSIONLESS: &[&str] = &[
    "armed",
    "block",
    "body",
    "camera_matrix",
    "capacity",
    "code",
    "command",
    "count",
    "distortion",
    "done",
    "dropped",
    "edge",
    "edge_status",
    "edges",
    "epoch",
    "force_law",
    "force_law_probability",
    "frame",
    "gamma",
    "given",
    "impulse_ratio",
    "index",
    "interval",
    "keep_last",
    "kind",
    "known",
    "line",
    "lost",
    "max",
    "method",
    "min",
    "min_zncc",
    "number",
    "of",
    "order",
    "outline",
    "peak_ratio",
    "phase",
    "pid",
    "pixel_format",
    "playback_rate",
    "points",
    "port",
    "recordings",
    "reserved",
    "restarts",
    "restitution",
    "restitution_tangential",
    "revision",
    "role",
    "rotation_status",
    "sequence",
    "shot",
    "sigma",
    "spline_points",
    "state",
    "status",
    "taken",
    "target_frame",
    "text",
    "value",
    "version",
    "waiting",
    "worker",
    "zncc",
];

/// Endings of such numbers.
pub const DIMENSIONLESS_ENDINGS: &[&str] = &["_id", "_known", "_sequence"];

/// Lines a file may have.
pub const LINES_MAX: usize = 500;

/// Top folders that exist on one machine and not on the next.
pub const MACHINE_FOLDERS: &[&str] = &["home", "root", "tmp", "work", "Users", "mnt", "opt"];

/// Files that import each other in circles, for each room that has any. Whoever opens a circle lowers the number.
pub const IN_CIRCLES: &[(&str, usize)] = &[];

/// The number of imports past a mod.rs that each room may have; empty where every folder is entered by its mod.rs.
pub const PAST_THEIR_MOD_RS: &[(&str, usize)] = &[];

/// Breaches of the language guide that are allowed until the prose of a room, file or folder has been revised.
pub const UNDER_REVISION: &[(&str, usize)] = &[];
