//! Runs the same work at several noise levels.

use crate::error::ReportError;

/// Runs work at each noise level in its own thread; results are in the order of the levels.
pub(super) fn at_each<T: Send>(
    noise_db: &[f64],
    work: impl Fn(f64) -> Result<Vec<T>, ReportError> + Sync,
) -> Result<Vec<T>, ReportError> {
    let work = &work;
    std::thread::scope(|scope| {
        let threads: Vec<_> =
            noise_db.iter().map(|&noise_db| scope.spawn(move || work(noise_db))).collect();
        let mut all = Vec::new();
        for thread in threads {
            let died = |_| ReportError::Failure("a thread of the report panicked".to_owned());
            all.extend(thread.join().map_err(died)??);
        }
        Ok(all)
    })
}
