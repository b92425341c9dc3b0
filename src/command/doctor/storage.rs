//! Shared memory, and the folder of the recordings.

use super::Finding;
use super::host::Host;
use crate::config::{Camera, Config};
use crate::image::PixelFormat;
use crate::interrupt;
use rustix::fs::statvfs;
use rustix::process::geteuid;
use std::fs::File;
use std::io::{self, Write};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::Instant;

/// The folder of the shared memory.
const SHARED_MEMORY: &str = "/dev/shm";
/// The shared memory of a rig without its ring of frames: topics, fields and their queues, bytes.
const TOPICS_BYTES: u64 = 128 << 20;
/// The ring of a rig whose file is not given, or does not state the size of its image, bytes.
const RING_BYTES: u64 = 256 << 20;
/// The number of bytes that are written for a measurement of the disk.
const TRIAL_BYTES: usize = 64 << 20;
/// The size of one write of that measurement, bytes.
const CHUNK_BYTES: usize = 4 << 20;
/// The room that a folder of recordings should have, bytes.
const FREE_BYTES: u64 = 2 << 30;

/// Examines the shared memory, and speed and space of the folder of the recordings.
pub(super) fn examine(host: &Host, config: Option<&Config>, directory: &Path) -> Vec<Finding> {
    examine_shared_memory(host, config).into_iter().chain(examine_folder(config, directory)).collect()
}

/// Returns the number of bytes per second of the frames of all cameras; `None` if the file leaves out a size or rate of
/// one.
fn bytes_per_second(config: &Config) -> Option<f64> {
    let cameras = std::iter::once(&config.camera).chain(config.views.iter().map(|view| &view.config.camera));
    let of_camera = |camera: &Camera| {
        let (width, height) = camera.image_px()?;
        let bytes_per_px = camera.pixel_format.unwrap_or(PixelFormat::Mono8).bytes_per_pixel();
        Some(f64::from(width) * f64::from(height) * bytes_per_px as f64 * camera.frame_rate_hz?)
    };
    cameras.map(of_camera).sum()
}

/// Examines the free shared memory, which the topics and twice the pre-trigger time of frames need.
///
/// A rig file that is not given, or states no size or rate, counts as [`RING_BYTES`] of frames.
fn examine_shared_memory(host: &Host, config: Option<&Config>) -> Option<Finding> {
    let place = host.path(SHARED_MEMORY);
    let Ok(stat) = statvfs(&place) else {
        let found = format!("{} is missing", place.display());
        let fix = format!("mkdir -p {0} && mount -t tmpfs tmpfs {0}", place.display());
        return Some(Finding::bad("shared memory", found, fix));
    };
    let ring = config.and_then(|config| Some(bytes_per_second(config)? * 2.0 * config.trigger.pre_s));
    let needed = TOPICS_BYTES + ring.map_or(RING_BYTES, |bytes| bytes as u64);
    let (free, total) = (stat.f_bavail * stat.f_frsize, stat.f_blocks * stat.f_frsize);
    let found = format!("{} MiB free, {} MiB needed", free >> 20, needed >> 20);
    if free >= needed {
        return Some(Finding::good("shared memory", found));
    }
    let mib = ((total - free + needed) >> 20) + 64;
    Some(Finding::bad("shared memory", found, format!("mount -o remount,size={mib}M {}", place.display())))
}

/// Examines whether the folder takes files, how fast, and its free space.
fn examine_folder(config: Option<&Config>, directory: &Path) -> Vec<Finding> {
    let name = directory.display();
    if !directory.is_dir() {
        let (found, fix) = (
            format!("{name} is not a folder"),
            format!("mkdir -p {0} && chown {1} {0}", quoted(directory), user_number()),
        );
        return vec![Finding::bad("recordings", found, fix)];
    }
    let speed = match measure_write_speed(directory) {
        Ok(speed) => speed,
        Err(error) => {
            let found = format!("{name} takes no file: {error}");
            return vec![Finding { fix: cure_of(&error, directory), ..Finding::bad("recordings", found, "") }];
        }
    };
    let mut findings = vec![Finding::good("recordings", format!("{name} takes files"))];
    let found = format!("{:.0} MB/s into {name}", 1e-6 * speed);
    findings.push(match config.and_then(bytes_per_second) {
        Some(needed) if needed > speed => Finding {
            fix: None,
            ..Finding::advice("disk speed", format!("{found}, and frames come at {:.0} MB/s", 1e-6 * needed), "")
        },
        _ => Finding::good("disk speed", found),
    });
    findings.extend(statvfs(directory).ok().map(|stat| {
        let free = stat.f_bavail * stat.f_frsize;
        let found = format!("{:.1} GB free in {name}", 1e-9 * free as f64);
        match free {
            free if free < FREE_BYTES => Finding { fix: None, ..Finding::advice("disk space", found, "") },
            _ => Finding::good("disk space", found),
        }
    }));
    findings
}

/// Returns a path in quotes, as one word of a shell.
pub(super) fn quoted(path: &Path) -> String {
    format!("'{}'", path.display().to_string().replace('\'', "'\\''"))
}

/// Returns the number of this user.
fn user_number() -> u32 {
    geteuid().as_raw()
}

/// Returns the command that lets a folder take files again; `None` if there is none, as for a full disk.
fn cure_of(error: &io::Error, directory: &Path) -> Option<String> {
    let name = quoted(directory);
    match error.kind() {
        io::ErrorKind::ReadOnlyFilesystem => Some(format!("mount -o remount,rw \"$(stat -c %m {name})\"")),
        io::ErrorKind::PermissionDenied => {
            let user = user_number();
            let is_own = directory.metadata().is_ok_and(|about| about.uid() == user);
            let chmod = format!("chmod u+rwx {name}");
            Some(if is_own { chmod } else { format!("chown {user} {name} && {chmod}") })
        }
        _ => None,
    }
}

/// Writes a file, syncs and removes it; returns the speed, bytes/s.
fn measure_write_speed(directory: &Path) -> io::Result<f64> {
    let path = directory.join(format!(".ricochet-trial-{}", std::process::id()));
    let _unfinished = interrupt::note(&path);
    let written = write_trial_file(&path);
    let removed = std::fs::remove_file(&path);
    written.and_then(|speed| removed.map(|()| speed))
}

/// Writes and syncs a new file of [`TRIAL_BYTES`]; returns the speed, bytes/s.
fn write_trial_file(path: &Path) -> io::Result<f64> {
    let mut file = File::options().write(true).create_new(true).open(path)?;
    // Some disks compress, so the bytes must not be equal.
    let chunk: Vec<u8> = (0..CHUNK_BYTES as u32).map(|k| (k.wrapping_mul(0x9E37_79B9) >> 24) as u8).collect();
    #[expect(clippy::disallowed_methods, reason = "measures the disk, not a film")]
    let started = Instant::now();
    for _ in 0..TRIAL_BYTES / CHUNK_BYTES {
        file.write_all(&chunk)?;
    }
    file.sync_all()?;
    Ok(TRIAL_BYTES as f64 / started.elapsed().as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deep_pixels_and_further_cameras_count() {
        let camera = "source = \"v4l2\"\nid = \"/dev/video0\"\nwidth_px = 640\nheight_px = 480\nframe_rate_hz = 100\n";
        let text = format!("[rig]\nname = \"one\"\n[camera]\n{camera}");
        let bytes = |text: &str| bytes_per_second(&Config::parse(text, "rig.toml").unwrap()).unwrap();
        assert!((bytes(&text) - 30.72e6).abs() < 1.0);
        let deep = format!("{text}pixel_format = \"Mono16\"\n");
        assert!((bytes(&deep) - 61.44e6).abs() < 1.0);
    }
}
