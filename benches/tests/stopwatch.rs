//! The two clocks, in a separate test program because CPU time includes all tests of a process.
#![allow(clippy::expect_used, reason = "a test")]

use benches::stopwatch::median;
use std::time::Duration;

#[test]
fn sleep_is_wall_time_and_not_cpu_time() {
    let times = median(3, || {
        std::thread::sleep(Duration::from_millis(50));
        Ok(())
    })
    .expect("sleeping does not fail");
    // half of the sleep is far above the cost of a system call
    assert!(times.wall_s >= 0.05 && times.cpu_s < 0.025, "{times:?}");
    assert!(times.least_cpu_s <= times.cpu_s, "{times:?}");
}
