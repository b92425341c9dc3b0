//! Tables and summaries of a recording.

use super::samples;
use crate::support::python;
use ricochet::command::{export, info};
use ricochet::console::Overwrite;
use ricochet::image::{Frame, PixelFormat};
use ricochet::recording::{EventRow, Recording, RecordingWriter, WriterOptions};
use ricochet::results::Estimate;

fn table(recording: &Recording, topic: &str) -> Vec<Vec<String>> {
    let mut text = Vec::new();
    export::write_table(recording, topic, &mut text, "memory").unwrap();
    let rows = csv::ReaderBuilder::new().has_headers(false).from_reader(&text[..]).into_records();
    rows.map(|row| row.unwrap().iter().map(str::to_owned).collect()).collect()
}

#[test]
fn the_columns_are_those_of_the_contract() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    samples::write(&path, &WriterOptions::default(), 4, [8, 8]).finish().unwrap();
    let recording = Recording::open(&path).unwrap();
    let header = |topic| table(&recording, topic)[0].join(", ");
    assert_eq!(
        header("velocity"),
        "frame, body, stamp_ns, t_s, center_x_px, center_y_px, radius_px, dx_px, dy_px, dtheta_deg, sigma_dx_px, \
         sigma_dy_px, sigma_dtheta_deg, vx_m_s, vy_m_s, vn_m_s, vt_m_s, omega_rad_s, sigma_v_m_s, sigma_omega_rad_s, \
         visible_fraction, phase, status, rotation_status"
    );
    assert_eq!(header("truth"), header("velocity"));
    assert_eq!(header("field"), "frame, x_px, y_px, u_px, v_px, sigma_u_px, sigma_v_px, zncc, peak_ratio, status");
    assert_eq!(
        header("track"),
        "frame, body, t_s, center_x_px, center_y_px, angle_deg, radius_px, sigma_center_px, sigma_angle_deg, \
         visible_fraction, status"
    );
    let impact = header("impact");
    assert!(
        impact.starts_with(
            "body, start_s, deepest_s, end_s, vn_before_m_s, vn_after_m_s, vt_before_m_s, vt_after_m_s, \
             omega_before_rad_s, omega_after_rad_s, restitution, restitution_tangential, impulse_ratio, \
             contact_time_s, compression_max_mm, acceleration_max_m_s2, force_law, slip_end_s, status, \
             sigma_start_s, sigma_deepest_s"
        ),
        "{impact}"
    );
    assert_eq!(impact.matches("sigma_").count(), 23);
    assert!(impact.ends_with(", force_law_probability"), "{impact}");
}

#[test]
fn numbers_read_back_exactly_and_missing_ones_are_empty() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    samples::write(&path, &WriterOptions::default(), 8, [8, 8]).finish().unwrap();
    let recording = Recording::open(&path).unwrap();
    let rows = table(&recording, "velocity");
    assert_eq!(rows.len(), 9);
    for (k, row) in (0..).zip(&rows[1..]) {
        let sample = samples::velocity(k, 0);
        assert_eq!(row[0..3], [k.to_string(), "ball".to_owned(), sample.stamp_ns.to_string()]);
        assert_eq!(row[3].parse::<f64>().unwrap().to_bits(), (k as f64 / 1e4).to_bits(), "{}", row[3]);
        let read = |cell: &str| (!cell.is_empty()).then(|| cell.parse::<f64>().unwrap().to_bits());
        assert_eq!(read(&row[4]), sample.center_x_px.map(f64::to_bits));
        assert_eq!(row[6], "", "no radius");
        assert_eq!(read(&row[7]), sample.motion.map(|s| s.dx_px.to_bits()));
        assert_eq!(read(&row[17]), sample.velocity.and_then(|v| Some(v.omega_rad_s?.to_bits())));
        let words = [sample.phase.as_str(), sample.status.as_str(), sample.rotation_status.as_str()];
        assert_eq!(row[21..], words);
    }
    let text = rows.concat().join(",");
    assert!(!text.contains("NaN") && !text.contains("inf"));
}

#[test]
fn rows_are_sorted_by_frame_and_body_and_count_from_the_first_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let mut writer = RecordingWriter::create(&path, &samples::info(), &WriterOptions::default()).unwrap();
    for (sequence, body) in [(102, 1), (102, 0), (100, 1), (101, 0), (100, 0)] {
        writer.write_velocity(&samples::velocity(sequence, body)).unwrap();
    }
    let (meta, bytes) = samples::frame(100, PixelFormat::Mono8, [8, 8], 0);
    writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
    writer.finish().unwrap();
    let rows = table(&Recording::open(&path).unwrap(), "velocity");
    let keys: Vec<_> = rows[1..].iter().map(|row| (row[0].as_str(), row[1].as_str(), row[3].as_str())).collect();
    let expected = [
        ("0", "ball", "0"),
        ("0", "racket", "0"),
        ("1", "ball", "0.0001"),
        ("2", "ball", "0.0002"),
        ("2", "racket", "0.0002"),
    ];
    assert_eq!(keys, expected);
}

#[test]
fn an_impact_appears_once_with_its_last_revision_and_times_from_the_first_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let mut writer = RecordingWriter::create(&path, &samples::info(), &WriterOptions::default()).unwrap();
    let (meta, bytes) = samples::frame(0, PixelFormat::Mono8, [8, 8], 0);
    writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
    for (number, revision) in [(0, 0), (0, 2), (0, 1), (1, 0)] {
        let mut impact = samples::impact(number, revision);
        impact.origin_ns = samples::START_NS + 1_000_000_000;
        impact.contact_time_s = Some(Estimate { value: 0.5, sigma: 0.25 });
        writer.write_impact(&impact).unwrap();
    }
    writer.finish().unwrap();
    let rows = table(&Recording::open(&path).unwrap(), "impact");
    let column = |name: &str| rows[0].iter().position(|column| column == name).unwrap();
    assert_eq!(rows.len(), 3);
    assert_eq!([&rows[1][column("restitution")], &rows[2][column("restitution")]], ["2.61", "0.61"]);
    assert_eq!(rows[1][column("start_s")], "1.0125");
    assert_eq!(rows[1][column("deepest_s")], "");
    assert_eq!(rows[1][column("sigma_deepest_s")], "");
    assert_eq!(
        (rows[1][column("contact_time_s")].as_str(), rows[1][column("sigma_contact_time_s")].as_str()),
        ("0.5", "0.25")
    );
    assert_eq!(rows[1][column("force_law")], "hunt-crossley");
}

#[test]
fn an_unknown_table_or_format_is_a_usage_error() {
    let options = export::ExportOptions {
        file: "missing.mcap".into(),
        topic: "speed".into(),
        format: export::Format::Csv,
        camera: None,
        output: None,
        film: Vec::new(),
        playback_hz: 25.0,
        overwrite: Overwrite::ALLOWED,
    };
    let error = export::run(&options).unwrap_err();
    assert!(matches!(error, export::ExportError::Usage(_)) && error.to_string().contains("velocity"), "{error}");
    let error = "xlsx".parse::<export::Format>().unwrap_err();
    assert!(error.to_string().contains("csv, parquet"), "{error}");
}

#[test]
fn info_counts_frames_losses_and_topics() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let mut writer = RecordingWriter::create(&path, &samples::info(), &WriterOptions::default()).unwrap();
    for sequence in [5, 6, 9, 10, 20] {
        let (meta, bytes) = samples::frame(sequence, PixelFormat::Mono12, [8, 6], 0);
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
    }
    writer.write_event(&samples::event(0)).unwrap();
    writer.finish().unwrap();
    let info = info::inspect(&Recording::open(&path).unwrap()).unwrap();
    assert_eq!((info.truncated, info.damage, info.frames_error), (None, Vec::new(), None));
    let frames = info.frames.unwrap();
    assert_eq!((frames.count, frames.lost, frames.gap_count), (5, Some(11), 2));
    assert_eq!(frames.gaps, [info::Gap { after: 6, lost: 2 }, info::Gap { after: 10, lost: 9 }]);
    assert_eq!((frames.width_px, frames.height_px, frames.pixel_format), (8, 6, "Mono12"));
    assert_eq!((frames.frame_rate_hz, frames.duration_s), (Some(10_000.0), 0.0015));
    let counts: Vec<_> = info.topics.iter().map(|t| (t.topic.as_str(), t.messages)).collect();
    assert_eq!(counts, [("/camera/frame_info", 5), ("/camera/image", 5), ("/events", 1)]);
    assert_eq!(info.attachments["config.toml"], samples::info().config_toml.len() as u64);
}

fn options(
    file: &std::path::Path,
    topic: &str,
    format: export::Format,
    output: &std::path::Path,
) -> export::ExportOptions {
    let (file, topic, output) = (file.into(), topic.into(), Some(output.into()));
    export::ExportOptions {
        file,
        topic,
        format,
        camera: None,
        output,
        film: Vec::new(),
        playback_hz: 25.0,
        overwrite: Overwrite::ALLOWED,
    }
}

/// The rows of a Parquet file as the texts of the CSV file, read with the crate's own reader.
fn parquet_table(path: &std::path::Path) -> Vec<Vec<String>> {
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::Field;
    let reader = SerializedFileReader::new(std::fs::File::open(path).unwrap()).unwrap();
    let columns = reader.metadata().file_metadata().schema_descr().columns().to_vec();
    let mut rows = vec![columns.iter().map(|column| column.name().to_owned()).collect::<Vec<_>>()];
    for row in reader.get_row_iter(None).unwrap() {
        let row = row.unwrap();
        let cell = |field: &Field| match field {
            Field::Null => String::new(),
            Field::Long(number) => number.to_string(),
            Field::ULong(number) => number.to_string(),
            Field::Double(number) => number.to_string(),
            Field::Float(number) => number.to_string(),
            Field::Str(text) => text.clone(),
            other => panic!("{other:?}"),
        };
        rows.push(row.get_column_iter().map(|(_, field)| cell(field)).collect());
    }
    rows
}

#[test]
fn parquet_holds_every_cell_of_the_csv_table() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    samples::write(&path, &WriterOptions::default(), 30, [8, 8]).finish().unwrap();
    let recording = Recording::open(&path).unwrap();
    for topic in export::TABLES {
        let target = folder.path().join(format!("{topic}.parquet"));
        let rows = export::run(&options(&path, topic, export::Format::Parquet, &target)).unwrap();
        let expected = table(&recording, topic);
        assert_eq!(rows.rows as usize, expected.len() - 1, "{topic}");
        assert_eq!(parquet_table(&target), expected, "{topic}");
    }
}

#[test]
fn pictures_show_the_frame_and_the_results_over_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let mut writer = RecordingWriter::create(&path, &samples::info(), &WriterOptions::default()).unwrap();
    for sequence in 100..103 {
        let (meta, bytes) = samples::frame(sequence, PixelFormat::Mono8, [320, 200], 0);
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
        let mut track = samples::track(sequence);
        (track.center_x_px, track.center_y_px, track.radius_px) = (Some(160.0), Some(100.0), Some(50.0));
        writer.write_track(&track).unwrap();
    }
    writer.finish().unwrap();
    let picture = |topic: &str, number: u32| {
        let name = format!("{topic}/{topic}_{number:06}.png");
        image::open(folder.path().join(name)).unwrap().to_rgb8()
    };
    for topic in export::PICTURES {
        let target = folder.path().join(topic);
        assert_eq!(export::run(&options(&path, topic, export::Format::Png, &target)).unwrap().rows, 3);
        assert_eq!(std::fs::read_dir(&target).unwrap().count(), 3);
    }
    let (plain, outlined) = (picture("frames", 2), picture("track", 2));
    let (_, bytes) = samples::frame(102, PixelFormat::Mono8, [320, 200], 0);
    assert_eq!(plain.dimensions(), (320, 200), "as it is");
    assert!(plain.pixels().zip(&bytes).all(|(pixel, level)| pixel.0 == [*level; 3]));
    assert_eq!(outlined.dimensions(), (640, 400), "enlarged twice");
    // Pixel (210, 100) is on the outline. Its centre lies at (421, 201) of the enlarged image.
    assert_eq!(outlined.get_pixel(421, 201).0, [53, 224, 111]);
    let differs = |x: u32, y: u32| plain.get_pixel(x / 2, y / 2) != outlined.get_pixel(x, y);
    let drawn = (0..400).flat_map(|y| (0..640).map(move |x| (x, y))).filter(|(x, y)| differs(*x, *y)).count();
    assert!((500..2000).contains(&drawn), "{drawn} pixels drawn");
}

#[test]
fn exported_frames_are_imported_again_with_every_grey_level() {
    for (format, kind) in [(PixelFormat::Mono8, image::ColorType::L8), (PixelFormat::Mono12, image::ColorType::L16)] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("shot.mcap");
        let mut writer = RecordingWriter::create(&path, &samples::info(), &WriterOptions::default()).unwrap();
        let (meta, bytes) = samples::frame(0, format, [64, 32], 0);
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
        writer.finish().unwrap();
        let target = folder.path().join("frames");
        export::run(&options(&path, "frames", export::Format::Png, &target)).unwrap();
        let picture = image::open(target.join("frames_000000.png")).unwrap();
        assert_eq!(picture.color(), kind);
        assert_eq!(picture.as_bytes(), &bytes[..], "{format:?}");
    }
}

#[test]
fn pictures_and_parquet_need_an_output_path() {
    for format in [export::Format::Png, export::Format::Parquet, export::Format::Npz] {
        let options =
            export::ExportOptions { output: None, ..options("shot.mcap".as_ref(), "field", format, "x".as_ref()) };
        let error = export::run(&options).unwrap_err();
        assert!(matches!(error, export::ExportError::Usage(_)) && error.to_string().contains("-o"), "{error}");
    }
    let velocity = options("shot.mcap".as_ref(), "velocity", export::Format::Png, "x".as_ref());
    assert!(matches!(export::run(&velocity).unwrap_err(), export::ExportError::Usage(_)));
}

#[test]
fn numpy_reads_the_columns_of_the_csv() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let mut writer = samples::write(&path, &WriterOptions::default(), 8, [8, 8]);
    for text in ["disarmed", "Gr\u{f6}\u{df}e \u{1d6fc}", ""] {
        let event = EventRow { stamp_ns: u64::MAX - 1, kind: "storage".into(), text: text.into() };
        writer.write_event(&event).unwrap();
    }
    writer.finish().unwrap();
    for (topic, rows) in
        [("velocity", 8), ("field", 0), ("track", 8), ("impact", 1), ("events", 3), ("truth_impact", 0)]
    {
        let [npz, csv] = ["npz", "csv"].map(|ending| folder.path().join(format!("{topic}.{ending}")));
        for (format, output) in [(export::Format::Npz, &npz), (export::Format::Csv, &csv)] {
            let (file, topic, output) = (path.clone(), topic.to_owned(), Some(output.clone()));
            export::run(&export::ExportOptions {
                file,
                topic,
                format,
                camera: None,
                output,
                film: Vec::new(),
                playback_hz: 25.0,
                overwrite: Overwrite::ALLOWED,
            })
            .unwrap();
        }
        let Some(printed) = python(include_str!("read_npz.py"), &[&npz, &csv]) else { return };
        let count: usize = printed.trim().parse().unwrap();
        assert!(count >= rows, "{topic}: {count} rows");
    }
}
