//! A recorder killed at random times: its file is recovered and gives the same results.

use super::recover::xorshift;
use crate::pipeline::drift;
use crate::support::{Background, Rig, csv, frames, kill, ricochet, run, succeed, wait_until};
use ricochet::image::{Frame, FrameMeta};
use ricochet::recording::{Recording, RecordingInfo, RecordingWriter, WriterOptions, part_path};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

const RATE_HZ: f64 = 2000.0;
/// A film of 1.5 s.
const FRAMES: u64 = 3000;

type Film = Vec<(FrameMeta, Vec<u8>)>;

/// The process of this role among the children of `parent`.
fn child(parent: u32, role: &str) -> Option<u32> {
    let children = std::fs::read_to_string(format!("/proc/{parent}/task/{parent}/children")).ok()?;
    let is_role = |pid: &&str| {
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        line.split(|byte| *byte == 0).nth(1) == Some(role.as_bytes())
    };
    children.split_whitespace().find(is_role)?.parse().ok()
}

/// The frames of the film that lie complete in a file, found by their pixels alone.
fn whole_frames(file: &[u8], film: &Film) -> Vec<u64> {
    let size = film[0].1.len();
    let by_sum: BTreeMap<u32, &(FrameMeta, Vec<u8>)> = film.iter().map(|f| (crc32fast::hash(&f.1), f)).collect();
    assert_eq!(by_sum.len(), film.len(), "no two frames are alike");
    // The pixels follow the tag of their field in the message, and their length.
    let mut mark = vec![6 << 3 | 2];
    prost::encoding::encode_varint(size as u64, &mut mark);
    let marked = file.windows(mark.len()).enumerate().filter(|(_, window)| *window == mark).map(|(at, _)| at);
    let pixels = marked.filter_map(|at| file.get(at + mark.len()..at + mark.len() + size));
    let known = pixels.filter_map(|pixels| by_sum.get(&crc32fast::hash(pixels)).filter(|frame| frame.1 == pixels));
    known.map(|(meta, _)| meta.sequence).collect()
}

/// Kills the recorder of a rig at 2000 frames per second after this time of writing, and returns its part file.
fn kill_after(rig: &Rig, film: &Path, time: Duration) -> PathBuf {
    let camera = format!("source = \"recording\"\nid = \"{}\"\npaced = true", film.display());
    let config = rig.config(&camera, "[scale]\nmm_per_px = 0.5\n[workers]\ncount = 1");
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let part = wait_until("it writes", || {
        let entries = std::fs::read_dir(rig.path("shots")).ok()?;
        let part = entries.map(|entry| entry.unwrap().path()).find(|path| path.extension().unwrap() == "part")?;
        // Metadata and configuration take 2 kB.
        (part.metadata().ok()?.len() > 100_000).then_some(part)
    });
    let recorder = child(service.0.id(), "record").expect("the recorder runs");
    std::thread::sleep(time);
    kill(recorder, 9);
    // Stopped before the rig starts another recorder.
    service.signal(9);
    let gone = || std::fs::read_to_string(format!("/proc/{recorder}/stat")).map_or(true, |stat| stat.contains(") Z "));
    wait_until("the recorder is gone", || gone().then_some(()));
    part
}

/// Writes the same frames as an undisturbed recording.
fn write_again(path: &Path, film: &Film, sequences: &[u64], like: &Path) {
    let like = Recording::open(like).unwrap();
    let config_toml = like.config_toml().unwrap().to_owned();
    let info = RecordingInfo { config_toml, metadata: like.metadata().clone(), ..RecordingInfo::default() };
    let mut writer = RecordingWriter::create(path, &info, &WriterOptions::default()).unwrap();
    for (meta, bytes) in film.iter().filter(|(meta, _)| sequences.contains(&meta.sequence)) {
        writer.write_frame(&Frame { meta: *meta, bytes }).unwrap();
    }
    writer.finish().unwrap();
}

fn velocity_of(film: &Path, to: &Path) -> String {
    let output = run(["analyze".as_ref(), film.as_os_str(), "-o".as_ref(), to.as_os_str()]);
    // A busy machine may have lost frames during recording. That is reported, and equal in both files.
    assert!(matches!(output.status.code(), Some(0 | 6)), "{}", String::from_utf8_lossy(&output.stderr));
    csv(to, "velocity")
}

fn kill_at(moments: u32) {
    let home = Rig::new();
    let scenario = home.file("drift.toml", &drift(FRAMES, RATE_HZ));
    let source = home.path("film.mcap");
    succeed(["simulate".as_ref(), scenario.as_os_str(), "-o".as_ref(), source.as_os_str()]);
    let film = frames(&source);
    let mut random = xorshift(0x05ee_d0fd_15c0);
    let (mut fewest, mut most, mut behind_header) = (usize::MAX, 0, 0);
    for moment in 0..moments {
        let time = Duration::from_micros(random(900_000) as u64);
        let rig = Rig::new();
        let part = kill_after(&rig, &source, time);
        let bytes = std::fs::read(&part).unwrap();
        let written = whole_frames(&bytes, &film);

        let whole = part.with_extension("");
        assert_eq!(part_path(&whole), part);
        let output = run(["recover".as_ref(), part.as_os_str(), "-o".as_ref(), whole.as_os_str()]);
        assert_eq!(output.status.code(), Some(6), "{}", String::from_utf8_lossy(&output.stderr));
        assert_eq!(std::fs::read(&part).unwrap(), bytes, "the old file is untouched");
        let recovered = frames(&whole);
        let sequences: Vec<u64> = recovered.iter().map(|(meta, _)| meta.sequence).collect();
        assert_eq!(sequences, written, "moment {moment}, after {time:?}");
        assert!(recovered.iter().all(|frame| film[frame.0.sequence as usize] == *frame), "moment {moment}");

        // The frames that a reader gets that stops at the open chunk.
        let finished = mcap_frames(&bytes);
        behind_header += written.len() - finished;
        (fewest, most) = (fewest.min(written.len()), most.max(written.len()));
        let again = rig.path("again.mcap");
        write_again(&again, &film, &sequences, &whole);
        let (saved, before) = (velocity_of(&whole, &rig.path("a.mcap")), velocity_of(&again, &rig.path("b.mcap")));
        assert!(before.lines().count() == sequences.len() + 1, "one row per frame");
        assert_eq!(saved, before, "moment {moment}, {} frames", sequences.len());
    }
    println!(
        "{moments} kills at {RATE_HZ} frames/s: {fewest} to {most} frames written completely, all recovered; \
         {behind_header} of them were in open chunks"
    );
    assert!(most > fewest + 100, "the moments differ");
    assert!(behind_header > 0, "some stood in an open chunk");
}

/// The number of frames that the mcap crate reads from a truncated file.
fn mcap_frames(bytes: &[u8]) -> usize {
    let options = mcap::read::Options::IgnoreEndMagic.into();
    let Ok(messages) = mcap::MessageStream::new_with_options(bytes, options) else { return 0 };
    messages.map_while(Result::ok).filter(|message| message.channel.topic == "/camera/image").count()
}

#[test]
fn a_recorder_killed_at_2000_frames_per_second_loses_no_written_frame() {
    kill_at(5);
}

#[test]
#[ignore = "the long form of the test above: two minutes"]
fn a_recorder_killed_at_50_moments_loses_no_written_frame() {
    kill_at(50);
}
