//! Tests of the queue.

use super::worker::{LAST_MESSAGES, Worker};
use super::*;
use std::sync::Arc;

fn frame(sequence: u64) -> TouchFrame<'static> {
    TouchFrame { number: sequence, sequence, whole: true, ..TouchFrame::default() }
}

/// A blocked sink costs the oldest frames, each of which is counted, and no time.
#[test]
fn a_full_queue_drops_the_oldest_and_counts() {
    let outbox = Outbox::default();
    let frames = CAPACITY as u64 + 36;
    (0..frames).for_each(|sequence| outbox.frame(&frame(sequence)));
    let wanted = SinkStatistics { frames, dropped_frames: 36, dropped_events: 0 };
    assert_eq!(outbox.statistics(), wanted);
    for sequence in 36..frames {
        match outbox.next(Duration::ZERO) {
            Next::Frame(copy) => assert_eq!(copy.sequence, sequence),
            other => panic!("{other:?}"),
        }
    }
    assert!(matches!(outbox.next(Duration::ZERO), Next::Nothing));
}

/// Frames that have waited too long are dropped, although the queue has room.
#[test]
fn what_is_old_is_dropped() {
    let outbox = Outbox::default();
    (0..3).for_each(|sequence| outbox.frame(&frame(sequence)));
    let past = Instant::now().checked_sub(2 * LONGEST).unwrap();
    outbox.state().queue.iter_mut().take(2).for_each(|(since, _)| *since = past);
    outbox.frame(&frame(3));
    assert_eq!(outbox.statistics().dropped_frames, 2);
    assert!(matches!(outbox.next(Duration::ZERO), Next::Frame(copy) if copy.sequence == 2));
}

#[test]
fn the_latest_image_replaces_one_that_was_not_sent() {
    let outbox = Outbox::default();
    for value in [1.0, 2.0] {
        outbox.image(eit_skin::ndarray::arr2(&[[value, f64::NAN]]).view(), 0.0);
    }
    let Next::Image(image) = outbox.next(Duration::ZERO) else { panic!("an image") };
    assert_eq!((image.rows, image.columns, image.values[0]), (1, 2, 2.0));
    assert!(image.values[1].is_nan());
    assert!(matches!(outbox.next(Duration::ZERO), Next::Nothing));
}

/// From the largest frame on, queueing allocates nothing.
#[test]
fn nothing_is_allocated_for_a_frame() {
    let outbox = Outbox::default();
    // every slot, and the one that is in flight
    (0..2 * CAPACITY as u64).for_each(|sequence| outbox.frame(&frame(sequence)));
    let counted = allocation_counter::measure(|| {
        (0..100).for_each(|sequence| outbox.frame(&frame(sequence)));
    });
    assert_eq!(counted.count_total, 0);
}

/// The end waits for queued messages, but not forever.
#[test]
fn the_end_is_bounded() {
    let outbox = Arc::new(Outbox::default());
    let (sender, receiver) = std::sync::mpsc::channel();
    let mut worker = Worker::start("test", Arc::clone(&outbox), move |outbox| {
        while let Next::Frame(frame) = outbox.next(Duration::from_secs(5)) {
            sender.send(frame.sequence).unwrap();
        }
    })
    .unwrap();
    (0..10).for_each(|sequence| outbox.frame(&frame(sequence)));
    worker.finish();
    assert_eq!(receiver.try_iter().collect::<Vec<_>>(), (0..10).collect::<Vec<_>>());

    let (sender, receiver) = std::sync::mpsc::channel::<()>();
    let mut stuck = Worker::start("test", Arc::default(), move |_| {
        let _ = receiver.recv();
    })
    .unwrap();
    let start = Instant::now();
    stuck.finish();
    assert!(start.elapsed() < 2 * LAST_MESSAGES, "{:?}", start.elapsed());
    drop(sender);
}
