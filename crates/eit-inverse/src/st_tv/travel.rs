//! How far images and duals travel, from which long runs balance their steps.

use super::duals::Duals;
use super::lanes::Project;
use super::state::State;
use super::step::weighted;

/// Images and duals of an earlier iterate.
///
/// ```text
/// ratio^2 = |x - x_0|^2_{T^-1} / |q - q_0|^2_{Sigma^-1}      over all duals q
/// ```
///
/// Steps are balanced if both travel equally far. The norms of images and duals, from which a step map is
/// balanced, say nothing of that where the image has far to go under a small force: in a direction that the
/// constraints of the data leave free, or that few channels see. Applegate et al. (*Practical large-scale linear
/// programming using primal-dual hybrid gradient*, NeurIPS 2021, section 3.3) balance their steps likewise.
pub(crate) struct Travel<T> {
    image: Vec<T>,
    duals: Duals<T>,
}

impl<T: Project> Travel<T> {
    /// Starts from the current iterate.
    pub(crate) fn from(state: &State<T>) -> Self {
        Self { image: state.images().collect(), duals: state.duals.clone() }
    }

    /// Returns `ratio` since the start or the last call, in the metric of the current steps: 1 if nothing moved,
    /// infinite if only the image did.
    pub(crate) fn ratio(&mut self, state: &State<T>) -> f64 {
        let State { frames, cells, groups, origin, change, tau, split, .. } = state;
        let (frames, cells, now, before) = (*frames, *cells, &state.duals, &self.duals);
        let moved = |at: usize| ((origin[at] + change[at]) - self.image[at]).to_f64();
        let image = weighted(frames, cells, moved, |step| state.cell_step[step].to_f64());
        let tau = |step: usize| tau[step].to_f64();
        let of = |now: &[T], before: &[T]| {
            let known = if now.is_empty() { 0 } else { frames };
            weighted(known, cells, |at| (now[at] - before[at]).to_f64(), tau)
        };
        let held = match state.chain {
            // exact steps change the sum
            Some(_) => {
                let moved = |at: usize| now.merged(at) - before.merged(at);
                weighted(frames, cells, moved, tau) / split[1]
            }
            None => {
                of(&now.links, &before.links) / split[1] + of(&now.held, &before.held) / split[2]
            }
        };
        let flow: f64 = now.flow.iter().zip(&before.flow).fold(0.0, |sum, (now, before)| {
            let per_sigma = |step: usize| 1.0 / state.group_step[step].to_f64();
            sum + weighted(frames, *groups, |at| (now[at] - before[at]).to_f64(), per_sigma)
        });
        self.image.iter_mut().zip(state.images()).for_each(|(own, x)| *own = x);
        self.duals.take(&state.duals, 1.0);
        match (image / (flow + held)).sqrt() {
            ratio if ratio.is_nan() => 1.0,
            ratio => ratio,
        }
    }
}
