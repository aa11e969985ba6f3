//! Help, streams and exit status: what every command has in common.

mod cli_common;

use std::io::pipe;
use std::process::Stdio;

use cli_common::{Folder, Run, command};

const COMMANDS: [&str; 13] = [
    "",
    "demo",
    "render",
    "detect",
    "reconstruct",
    "monitor",
    "configure",
    "eval",
    "budget",
    "rig",
    "rig show",
    "rig check",
    "rig default",
];

#[test]
fn help_of_every_command_shows_an_example() {
    let folder = Folder::new();
    for command in COMMANDS {
        let help = folder.run(&format!("{command} --help")).done().stdout;
        assert!(help.contains("\nExample") && help.contains(&format!("\n  karst {command}")), "{command}: {help}");
    }
}

#[test]
fn examples_in_the_help_are_valid_usage() {
    let folder = Folder::new();
    for command in COMMANDS {
        let help = folder.run(&format!("{command} --help")).done().stdout;
        for example in help.lines().filter_map(|line| line.strip_prefix("  karst ")) {
            // Without the remark or redirection after it. With --help the arguments are parsed and nothing runs.
            let arguments = example.split("  ").next().unwrap().split(" > ").next().unwrap();
            folder.run(&format!("{arguments} --help")).done();
        }
    }
}

#[test]
fn every_command_with_a_result_prints_it_as_json() {
    let folder = Folder::new();
    folder.write_dark_picture("1.png");
    for arguments in [
        "demo --json",
        "render --out out --json",
        "detect 1.png --json",
        "reconstruct --rig rig.toml 1.png 1.png --json",
        "monitor --simulated --frames 1 --json",
        "configure --simulated --rig rig.toml --json",
        "rig show --json",
        "rig check rig.toml --json",
    ] {
        folder.run(arguments).done().json();
    }
    // Too long to run here.
    assert!(folder.run("eval --help").done().stdout.contains("--json"));
}

#[test]
fn version_is_the_packages() {
    assert_eq!(Folder::new().run("--version").done().stdout, format!("karst {}\n", env!("CARGO_PKG_VERSION")));
}

#[test]
fn reader_that_has_seen_enough_is_no_failure() {
    let folder = Folder::new();
    folder.write_dark_sequence(&[1, 2, 3]);
    folder.write("camera1/0002.png", "not a picture");
    for (arguments, status) in [
        ("--help", 0),
        ("demo", 0),
        ("render --out out", 0),
        ("detect camera1/0001.png", 0),
        ("rig default", 0),
        ("rig show --json", 0),
        ("rig check rig.toml", 0),
        ("reconstruct --rig rig.toml camera1/0001.png camera2/0001.png", 0),
        // The status still tells about the frames.
        ("reconstruct --rig rig.toml camera1 camera2 --json", 3),
    ] {
        let (reader, writer) = pipe().unwrap();
        drop(reader);
        let output = command(folder.root(), arguments).stdout(writer).stderr(Stdio::piped()).output().unwrap();
        let run = Run::new(arguments, output).status(status);
        assert!(!run.stderr.contains("error"), "{}", run.stderr);
    }
}

#[test]
fn standard_error_without_a_reader_changes_no_status() {
    let folder = Folder::new();
    for (arguments, status) in [("rig check nowhere.toml", 1), ("render", 2)] {
        let (reader, writer) = pipe().unwrap();
        drop(reader);
        let output = command(folder.root(), arguments).stderr(writer).output().unwrap();
        Run::new(arguments, output).status(status);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn full_disk_under_standard_output_is_a_failure() {
    let folder = Folder::new();
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let output = command(folder.root(), "rig default").stdout(full).stderr(Stdio::piped()).output().unwrap();
    Run::new("rig default", output).fails("cannot write to standard output: ");
}

#[test]
fn no_color_wins() {
    let folder = Folder::new();
    let stderr = |no_color: &str| {
        let mut command = command(folder.root(), "demo --fast");
        let output = command.env("CLICOLOR_FORCE", "1").env("NO_COLOR", no_color).output().unwrap();
        Run::new("demo --fast", output).status(2).stderr
    };
    assert!(stderr("").contains('\x1b'));
    assert!(!stderr("1").contains('\x1b'));
}

#[test]
fn progress_is_hidden_when_standard_error_is_no_terminal() {
    // `done` asserts that standard error is empty.
    Folder::new().run("render --out out --frames 2").done();
}
