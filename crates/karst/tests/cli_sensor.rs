//! `karst monitor` and `karst configure`, with the simulated sensor in the program and at the end of a serial line.

mod cli_common;

use std::path::PathBuf;
use std::sync::LazyLock;

use cli_common::{Folder, points, run};
use serde_json::Value;

/// Three frames along a gallery in `survey`: rendered once for all tests.
static RENDERED: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("cli_sensor");
    std::fs::create_dir_all(&folder).unwrap();
    run(&folder, "render --out survey --frames 3 --to 0,0,600").done();
    folder
});

const SURVEY: &str = "--rig survey/rig.toml survey/camera1 survey/camera2";

/// The objects of a run with `--json`, one in each line.
fn objects(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn pictures_give_the_points_of_reconstruct_once_and_in_every_file() {
    let folder = Folder::new();
    let out = folder.path("result");
    let monitored = run(&RENDERED, &format!("monitor --simulated {SURVEY} --json --out {}", out.display())).done();
    let frames = objects(&monitored.stdout);
    let reconstructed = run(&RENDERED, &format!("reconstruct {SURVEY} --json")).done().json();
    let sections = reconstructed["sections"].as_array().unwrap();
    assert_eq!((frames.len(), sections.len()), (3, 3));
    for (number, (frame, section)) in frames.iter().zip(sections).enumerate() {
        assert_eq!(points(frame), points(section));
        assert_eq!((&frame["complete"], &frame["lost_messages"]), (&true.into(), &0.into()));
        assert_eq!(frame["frames"]["complete"], number + 1);
        assert_eq!(frame["link"]["lost"], 0);
    }
    let count: usize = frames.iter().map(|frame| points(frame).iter().flatten().count()).sum();
    assert!(count > 30, "{count}");
    let vertices = format!("element vertex {count}\n");
    assert!(std::fs::read(out.join("points.ply")).unwrap().windows(vertices.len()).any(|b| b == vertices.as_bytes()));
    assert_eq!(std::fs::read_to_string(out.join("points.csv")).unwrap().lines().count(), 1 + 36);
    let recording = std::fs::read(out.join("points.mcap")).unwrap();
    assert_eq!(mcap::read::MessageStream::new(&recording).unwrap().count(), 3);
    let written: Value = serde_json::from_slice(&std::fs::read(out.join("sections.json")).unwrap()).unwrap();
    assert_eq!(written.as_array().unwrap().len(), 3);
}

#[test]
fn without_a_terminal_there_is_one_line_per_frame() {
    let text = Folder::new().run("monitor --simulated --frames 2").done().stdout;
    let lines: Vec<&str> = text.lines().collect();
    let [first, second, last] = lines[..] else { panic!("{text}") };
    assert!(first.starts_with("frame 1: 12 points of 12 lasers, range "), "{text}");
    assert!(second.starts_with("frame 2: 12 points of 12 lasers, range "), "{text}");
    assert_eq!(last, "2 frames: 2 complete, 0 incomplete, 0 missing");
}

#[test]
fn monitor_ends_when_nobody_reads() {
    let folder = Folder::new();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let output = cli_common::command(folder.root(), "monitor --simulated").stdout(writer).output().unwrap();
    cli_common::Run::new("monitor", output).done();
}

#[test]
fn a_picture_that_can_not_be_read_is_an_error_after_the_frames_before_it() {
    let folder = Folder::new();
    for camera in ["camera1", "camera2"] {
        let picture = std::fs::read(RENDERED.join(format!("survey/{camera}/0001.png"))).unwrap();
        folder.write(&format!("{camera}/0001.png"), &picture);
        folder.write(&format!("{camera}/0002.png"), picture);
    }
    folder.write("camera2/0002.png", "not a picture");
    let run = folder.run("monitor --simulated camera1 camera2 --json");
    assert_eq!(objects(&run.stdout).len(), 1);
    run.fails("camera2/0002.png is not an image: expected PNG or JPEG");
}

#[test]
fn configure_reads_back_what_it_has_sent() {
    let folder = Folder::new();
    let options = "--rig rig.toml --mode software --method paper --lasers on --spots on --trigger-hz 12.5";
    let found = folder.run(&format!("configure --simulated {options} --json")).done().json();
    for (key, value) in [
        ("mode", Value::from("software")),
        ("method", "paper".into()),
        ("lasers_on", true.into()),
        ("spots", true.into()),
        ("trigger_hz", 12.5.into()),
        ("is_rig", true.into()),
        ("program", env!("CARGO_PKG_VERSION").into()),
    ] {
        assert_eq!(found[key], value, "{key}: {found}");
    }
    assert_eq!(found["calibration"]["lasers"], 12);
    assert_eq!(found["calibration"]["image_sizes_px"], serde_json::json!([[1024, 768], [1024, 768]]));
    let text = folder.run(&format!("configure --simulated {options}")).done().stdout;
    assert!(text.ends_with("it is that of the rig file, value by value\n"), "{text}");
}

#[test]
fn configure_changes_nothing_that_is_not_given() {
    let folder = Folder::new();
    let found = folder.run("configure --simulated --lasers on --json").done().json();
    assert_eq!((&found["lasers_on"], &found["mode"]), (&true.into(), &"accelerated".into()));
    assert_eq!((&found["calibration"], &found["is_rig"]), (&Value::Null, &Value::Null));
    let found = folder.run("configure --simulated --read --json").done().json();
    assert_eq!(found["lasers_on"], false);
    let run = folder.run("configure --simulated --read --rig rig.toml");
    assert!(run.stdout.contains("no calibration: it measures nothing"), "{}", run.stdout);
    run.fails("the calibration of the sensor is not that of the rig file");
}

#[test]
fn wrong_usage() {
    let folder = Folder::new();
    for (arguments, words) in [
        ("monitor", "required"),
        ("monitor --simulated one.png", "--simulated takes the pictures of both cameras or none, and no port"),
        ("monitor nowhere --rig rig.toml", "--simulated"),
        ("monitor one.png two.png", "--simulated"),
        ("monitor --simulated --frames 0", "--frames"),
        ("configure nowhere", "required"),
        ("configure --rig rig.toml", "required"),
        ("configure nowhere --simulated --read", "cannot be used with"),
        ("configure --simulated --read --lasers on", "cannot be used with"),
        ("configure --simulated --trigger-hz 5000", "expected 0, or 0.001 to 1000"),
    ] {
        folder.run(arguments).misused(words);
    }
}

#[test]
fn a_port_that_is_not_there_or_no_port() {
    let folder = Folder::new();
    folder.run("monitor nowhere").fails("cannot open the serial port nowhere (found on this computer: ");
    folder.run("configure rig.toml --read").fails("cannot open the serial port rig.toml");
    folder.run("configure nowhere --rig nowhere.toml").fails("nowhere.toml");
}

/// A serial line: a pseudo-terminal with something at its other end.
#[cfg(target_os = "linux")]
mod port {
    use std::io::{BufRead, BufReader, Read, Write};
    use std::process::{Child, Command, Stdio};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::thread::JoinHandle;
    use std::time::{Duration, Instant};

    use karst::sensor::SimulatedSensor;
    use karst_link::{Encoder, Hello, MAX_FRAME, Message};
    use karst_rig::Rig;
    use karst_scene::{Renderer, demo_scene};
    use serialport::{SerialPort, TTYPort};

    use super::cli_common::{Folder, Run, command};

    /// A port of this computer.
    struct Port {
        name: String,
        stop: Arc<AtomicBool>,
        device: Option<JoinHandle<()>>,
        /// So that the line is there before and after the command opens it.
        _slave: TTYPort,
    }

    impl Port {
        /// With a device that answers; `new` makes it in its thread.
        fn with<D>(
            new: impl FnOnce() -> D + Send + 'static,
            mut step: impl FnMut(&mut D, &mut TTYPort) + Send + 'static,
        ) -> Self {
            let (inherited, slave) = TTYPort::pair().unwrap();
            // The commands that tests start must not hold this end: a clone stays in this process
            let mut master = inherited.try_clone_native().unwrap();
            drop(inherited);
            master.set_timeout(Duration::from_millis(2)).unwrap();
            let stop = Arc::new(AtomicBool::new(false));
            let stopped = stop.clone();
            let device = std::thread::spawn(move || {
                let mut device = new();
                while !stopped.load(Ordering::Relaxed) {
                    step(&mut device, &mut master);
                }
            });
            Self { name: slave.name().unwrap(), stop, device: Some(device), _slave: slave }
        }

        /// With a simulated sensor that sees the demo scene.
        fn with_sensor() -> Self {
            Self::with_sensor_until(Arc::default())
        }

        /// With one that does nothing any more when it is told so.
        fn with_sensor_until(asleep: Arc<AtomicBool>) -> Self {
            let scene = demo_scene();
            let images = Renderer::new(&Rig::default()).unwrap().render(&scene.scene, scene.seed).unwrap().images;
            let new = || SimulatedSensor::new(12, std::iter::repeat_with(move || Ok(images.clone())));
            Self::with(new, move |sensor, line| {
                if asleep.load(Ordering::Relaxed) {
                    return;
                }
                let mut bytes = [0; 256];
                if let Ok(count) = line.read(&mut bytes) {
                    sensor.write_all(&bytes[..count]).unwrap();
                }
                if let Ok(count) = sensor.read(&mut bytes) {
                    // Nobody may be there to read
                    let _ = line.write_all(&bytes[..count]);
                }
            })
        }

        fn unplug(&mut self) {
            self.stop.store(true, Ordering::Relaxed);
            if let Some(device) = self.device.take() {
                device.join().unwrap();
            }
        }
    }

    impl Drop for Port {
        fn drop(&mut self) {
            self.unplug();
        }
    }

    /// Starts the command and waits for so many lines of its standard output.
    fn start(folder: &Folder, arguments: &str, lines: usize) -> Child {
        let mut command = command(folder.root(), arguments);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut output = BufReader::new(child.stdout.take().unwrap());
        for _ in 0..lines {
            output.read_line(&mut String::new()).unwrap();
        }
        // What follows is not of interest, but must find a reader
        std::thread::spawn(move || std::io::copy(&mut output, &mut std::io::sink()));
        child
    }

    #[test]
    fn a_sensor_at_a_serial_port_is_configured_and_monitored() {
        let port = Port::with_sensor();
        let folder = Folder::new();
        let name = &port.name;
        folder.run(&format!("monitor {name}")).fails("the sensor has no calibration and measures nothing");
        let found = folder.run(&format!("configure {name} --rig rig.toml --lasers on --json")).done().json();
        assert_eq!(found["is_rig"], true);
        let found = folder.run(&format!("configure {name} --read --rig rig.toml --json")).done().json();
        assert_eq!((&found["is_rig"], &found["lasers_on"]), (&true.into(), &true.into()));
        let frames = super::objects(&folder.run(&format!("monitor {name} --frames 3 --json")).done().stdout);
        assert_eq!(frames.len(), 3);
        for frame in &frames {
            assert_eq!(super::points(frame).iter().flatten().count(), 12);
        }
    }

    #[test]
    fn the_blocks_of_the_readme_for_pc_and_fpga_give_the_same_points() {
        let readme = include_str!("../../../README.md");
        let (_, section) = readme.split_once("## The same section, three times").unwrap();
        let (section, _) = section.split_once("\n## ").unwrap();
        let commands: Vec<&str> = section.lines().filter_map(|l| l.strip_prefix("cargo run --release -- ")).collect();
        // The second one takes minutes: `cargo xtask hw sim soc` runs it
        let [demo, _, configure, monitor] = commands[..] else { panic!("{commands:?}") };
        let port = Port::with_sensor();
        let folder = Folder::new();
        for command in [demo, configure, monitor] {
            folder.run(&command.replace("/dev/ttyUSB0", &port.name)).done();
        }
        let [pc, fpga] = ["pc", "fpga"].map(|name| std::fs::read(folder.path(name).join("points.ply")).unwrap());
        assert!(pc == fpga && pc.len() > 12 * 20, "{} and {} bytes", pc.len(), fpga.len());
    }

    #[test]
    fn a_port_that_is_unplugged_ends_the_monitor_which_keeps_what_it_has() {
        let mut port = Port::with_sensor();
        let folder = Folder::new();
        folder.run(&format!("configure {} --rig rig.toml --lasers on", port.name)).done();
        let arguments = format!("monitor {} --out result", port.name);
        let child = start(&folder, &arguments, 3);
        port.unplug();
        let run = Run::new(&arguments, child.wait_with_output().unwrap());
        run.fails("the line to the sensor broke: ");
        assert!(std::fs::read_to_string(folder.path("result/points.csv")).unwrap().lines().count() > 3 * 12);
    }

    #[test]
    fn ctrl_c_ends_the_monitor_and_writes_the_files() {
        let port = Port::with_sensor();
        let folder = Folder::new();
        folder.run(&format!("configure {} --rig rig.toml --lasers on", port.name)).done();
        let arguments = format!("monitor {} --out result", port.name);
        let child = start(&folder, &arguments, 2);
        assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
        Run::new(&arguments, child.wait_with_output().unwrap()).done();
        assert!(folder.path("result/points.mcap").is_file());
    }

    #[test]
    fn a_silent_line_is_an_error_and_soon() {
        let port = Port::with(|| {}, |(), _| std::thread::sleep(Duration::from_millis(1)));
        let folder = Folder::new();
        let start = Instant::now();
        for arguments in [format!("monitor {}", port.name), format!("configure {} --rig rig.toml", port.name)] {
            folder.run(&arguments).fails("nothing answers: is the sensor on, and is this its line?");
        }
        assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
    }

    #[test]
    fn a_sensor_that_falls_silent_is_an_error() {
        let asleep = Arc::new(AtomicBool::new(false));
        let port = Port::with_sensor_until(asleep.clone());
        let folder = Folder::new();
        folder.run(&format!("configure {} --rig rig.toml --lasers on", port.name)).done();
        let arguments = format!("monitor {}", port.name);
        let child = start(&folder, &arguments, 2);
        asleep.store(true, Ordering::Relaxed);
        Run::new(&arguments, child.wait_with_output().unwrap()).fails("the sensor has fallen silent");
    }

    #[test]
    fn a_sensor_of_an_older_protocol() {
        let hello = Hello { oldest_protocol: 0, newest_protocol: 0, program: [0, 0, 9], lasers: 12 };
        let answer = Encoder::new().encode(&Message::Hello(hello), &mut [0; MAX_FRAME]).unwrap().to_vec();
        let port = Port::with(
            || {},
            move |(), line| {
                if line.read(&mut [0; 256]).is_ok() {
                    line.write_all(&answer).unwrap();
                }
            },
        );
        let folder = Folder::new();
        let words = "the other end speaks protocol 0 to 0, this one 2 to 2: update the older one";
        folder.run(&format!("monitor {}", port.name)).fails(words);
        folder.run(&format!("configure {} --rig rig.toml", port.name)).fails(words);
    }
}
