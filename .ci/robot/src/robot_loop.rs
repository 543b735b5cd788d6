//! A control loop that reads touches at its own rate, whatever the instrument does.
use eit_skin::{Next, Skin, SkinError, Touch};
use std::time::{Duration, Instant};

pub const TICK: Duration = Duration::from_millis(10);

/// Calls `control` at every tick with the latest touches (`None` if the instrument is silent or the reference
/// is being taken) until `control` returns false or the source ends. Returns the number of late ticks.
pub fn run(
    skin: &Skin,
    port: Option<&str>,
    mut control: impl FnMut(Option<&[Touch]>) -> bool,
) -> Result<usize, SkinError> {
    let mut sensor = skin.open_at(port)?;
    let (mut due, mut late) = (Instant::now(), 0);
    loop {
        due += TICK;
        while let Some(left) = due.checked_duration_since(Instant::now()) {
            if let Next::Over = sensor.next_within(left)? {
                return Ok(late);
            }
        }
        if !control(sensor.touches_within(10 * TICK)) {
            return Ok(late);
        }
        if due.elapsed() > TICK {
            (late, due) = (late + 1, Instant::now()); // lost ticks are not made up for
        }
    }
}
