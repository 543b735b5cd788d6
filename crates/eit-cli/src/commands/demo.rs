//! `eit demo`

use super::{Answer, network, publish, view};
use crate::cli::DemoArgs;
use crate::error::CliError;
use crate::{interrupt, progress};
use eit_publish::{Publisher, Start};
use eit_report::settings::DemoSettings;
use eit_skin::live::{LiveFrame, LiveModel};
use ndarray::Axis;
use std::sync::{Mutex, PoisonError};

/// Runs the demo until its end or Ctrl-C.
pub(crate) fn run(args: &DemoArgs) -> Result<Answer, CliError> {
    let settings = DemoSettings { out: args.out.clone(), force: args.force, quick: args.quick };
    let published = match network::is_wanted(&args.network) {
        true => Some(Mutex::new(Published::new(network::open(&args.network, Publisher::new())?))),
        false => None,
    };
    let stop = interrupt::listen()?;
    let watch = |name: &str, model: &LiveModel, shown: &LiveFrame<'_>| {
        if let Some(published) = &published {
            published.lock().unwrap_or_else(PoisonError::into_inner).take(name, model, shown);
        }
    };
    let watcher = published.is_some().then_some(&watch as &eit_report::demo::FrameWatcher<'_>);
    let answer = eit_report::demo::run(&settings, watcher, &stop, &mut progress::terminal())?;
    if let Some(published) = published {
        published.into_inner().unwrap_or_else(PoisonError::into_inner).end()?;
    }
    Ok(answer)
}

/// Publishes the experiment that began last, since the experiments may overlap.
struct Published {
    publisher: Publisher,
    /// Names of the experiments so far.
    experiments: Vec<String>,
    failure: Option<CliError>,
}

impl Published {
    fn new(publisher: Publisher) -> Self {
        Self { publisher, experiments: Vec::new(), failure: None }
    }

    fn take(&mut self, name: &str, model: &LiveModel, shown: &LiveFrame<'_>) {
        // the demo goes on where publishing failed; the end reports it
        if self.failure.is_none() {
            self.failure = self.publish(name, model, shown).err();
        }
    }

    fn publish(
        &mut self,
        name: &str,
        model: &LiveModel,
        shown: &LiveFrame<'_>,
    ) -> Result<(), CliError> {
        if !self.experiments.iter().any(|known| known == name) {
            self.experiments.push(name.to_owned());
            self.publisher.skin(&publish::shape(model)?)?;
            self.publisher.start(&Start {
                skin: &model.skin().name,
                instrument: name,
                electrodes: model.skin().mesh.electrodes().len(),
                reference_frames: model.reference_frames,
                is_live: true,
            })?;
        } else if self.experiments.last().is_none_or(|last| last != name) {
            return Ok(());
        }
        let mut frame = eit_skin::TouchFrame::from(*shown);
        // numbers of touches begin anew
        frame.epoch = self.experiments.len() as u32 - 1;
        self.publisher.touches(&frame)?;
        if let Some(images) = shown.images
            && self.publisher.wants_image()
        {
            self.publisher.image(view::image(images)?.index_axis(Axis(0), 0))?;
        }
        Ok(())
    }

    fn end(self) -> Result<(), CliError> {
        match self.failure {
            Some(failure) => Err(failure),
            None => publish::end(self.publisher),
        }
    }
}
