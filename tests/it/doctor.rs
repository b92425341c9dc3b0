//! `ricochet doctor`: each misconfiguration is found, and the printed command mends it.

mod injected;

use crate::support::{Rig, ricochet};
use serde_json::Value;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};

/// A copy of the files in which a well-configured system describes itself.
const FILES: [(&str, &str); 9] = [
    ("proc/sys/net/core/rmem_max", "33554432"),
    ("sys/kernel/mm/transparent_hugepage/shmem_enabled", "always [within_size] advise never deny force"),
    ("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance"),
    ("sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "performance"),
    ("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc"),
    ("sys/devices/system/clocksource/clocksource0/available_clocksource", "tsc hpet acpi_pm"),
    ("sys/class/net/eth1/operstate", "up"),
    ("sys/class/net/eth1/type", "1"),
    ("sys/class/net/eth1/mtu", "9000"),
];

/// Makes a well-configured system in a folder.
fn system(root: &Path) {
    for (name, text) in FILES {
        let path = root.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    std::fs::create_dir_all(root.join("dev/shm")).unwrap();
    std::fs::create_dir_all(root.join("shots")).unwrap();
}

fn findings(output: &Output) -> Vec<Value> {
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    report["findings"].as_array().unwrap().clone()
}

/// Examines a system and returns the finding of this name.
fn examined(root: &Path, name: &str) -> Value {
    let output =
        ricochet(["doctor", "--json", "--root"]).arg(root).arg("--directory").arg(root.join("shots")).output().unwrap();
    let finding = findings(&output).into_iter().find(|finding| finding["name"] == name);
    finding.unwrap_or_else(|| panic!("no {name} in {output:?}"))
}

fn shell(command: &str) {
    let output = Command::new("sh").args(["-c", command]).output().unwrap();
    assert!(output.status.success(), "{command}: {output:?}");
}

/// Breaks a system, and checks that the finding and its command bring it back.
fn is_found_and_mended(name: &str, state: &str, breaks: impl Fn(&Path)) {
    let rig = Rig::new();
    let root = rig.path("root");
    system(&root);
    assert_eq!(examined(&root, name)["state"], "good", "{name} before");
    breaks(&root);
    let broken = examined(&root, name);
    assert_eq!(broken["state"], state, "{broken}");
    shell(broken["fix"].as_str().unwrap());
    assert_eq!(examined(&root, name)["state"], "good", "{name} after {}", broken["fix"]);
}

fn writes(name: &'static str, text: &'static str) -> impl Fn(&Path) {
    move |root| std::fs::write(root.join(name), text).unwrap()
}

#[test]
fn settings_of_the_kernel_are_found_and_mended() {
    is_found_and_mended("receive buffer", "advice", writes(FILES[0].0, "212992"));
    is_found_and_mended("frequency", "advice", writes(FILES[3].0, "powersave"));
    is_found_and_mended("clock", "advice", writes(FILES[4].0, "hpet"));
}

#[test]
fn small_pages_of_shared_memory_are_found() {
    let rig = Rig::new();
    let root = rig.path("root");
    system(&root);
    std::fs::write(root.join(FILES[1].0), "always within_size advise [never] deny force").unwrap();
    let broken = examined(&root, "huge pages");
    assert_eq!(broken["state"], "advice");
    // The kernel puts the brackets around the word that is written; a plain file keeps the word alone.
    shell(broken["fix"].as_str().unwrap());
    assert_eq!(std::fs::read_to_string(root.join(FILES[1].0)).unwrap().trim(), "within_size");
}

#[test]
fn small_packets_are_found_with_the_command_of_their_interface() {
    let rig = Rig::new();
    let root = rig.path("root");
    system(&root);
    std::fs::write(root.join(FILES[8].0), "1500").unwrap();
    let broken = examined(&root, "packets");
    assert_eq!((&broken["state"], &broken["fix"]), (&"advice".into(), &"ip link set dev eth1 mtu 9000".into()));
    std::fs::write(root.join(FILES[6].0), "down").unwrap();
    let output = ricochet(["doctor", "--json", "--root"]).arg(&root).output().unwrap();
    assert!(findings(&output).iter().all(|finding| finding["name"] != "packets"), "an interface that is down");
}

#[test]
fn a_folder_that_takes_no_recording_is_found_and_mended() {
    is_found_and_mended_folder("is not a folder", |root| std::fs::remove_dir(root.join("shots")).unwrap());
    if rustix::process::geteuid().is_root() {
        return;
    }
    is_found_and_mended_folder("takes no file", |root| {
        std::fs::set_permissions(root.join("shots"), std::fs::Permissions::from_mode(0o555)).unwrap();
    });
}

fn is_found_and_mended_folder(reason: &str, breaks: impl Fn(&Path)) {
    let rig = Rig::new();
    let root = rig.path("root");
    system(&root);
    breaks(&root);
    let broken = examined(&root, "recordings");
    assert_eq!(broken["state"], "bad");
    assert!(broken["found"].as_str().unwrap().contains(reason), "{broken}");
    shell(broken["fix"].as_str().unwrap());
    assert_eq!(examined(&root, "disk space")["name"], "disk space");
}

#[test]
fn the_report_names_each_property_and_the_exit_code_counts_what_is_wrong() {
    let rig = Rig::new();
    let root = rig.path("root");
    system(&root);
    let run = |folder: &str| {
        ricochet(["doctor", "--root"]).arg(&root).arg("--directory").arg(root.join(folder)).output().unwrap()
    };
    let good = run("shots");
    assert!(good.status.success(), "{good:?}");
    let bad = run("nowhere");
    assert_eq!(bad.status.code(), Some(2), "{bad:?}");
    let text = String::from_utf8(bad.stdout).unwrap();
    assert!(text.contains("Commands that mend it"), "{text}");
    assert!(text.contains("mkdir -p '"), "{text}");
}
