//! The sensor against the software model of the IP: what a host sees on the line.

mod bench;
mod calibration;
mod faults;
mod frames;

#[test]
fn a_sensor_of_twelve_lasers_takes_less_than_ten_kibibytes() {
    // Pointers of a PC are twice as long as the firmware's
    let size = size_of_val(&bench::Bench::new(Default::default(), Default::default()).sensor);
    assert!(size < 10 * 1024, "{size}");
}
