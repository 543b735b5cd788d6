//! `eit demo`

use super::{Answer, network, publish};
use crate::cli::DemoArgs;
use crate::error::CliError;
use crate::{interrupt, progress};
use eit_hw::driver::{Event, Pace, Replay};
use eit_publish::{Publisher, Start};
use eit_report::demo::RECORDINGS;
use eit_report::settings::DemoSettings;
use eit_skin::StopFlag;
use eit_skin::live::{LiveModel, LiveObserver, REFERENCE_FRAMES, Summary, TouchFrame};
use eit_skin::scene::Scene;
use eit_skin::words::printable;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Runs the demo until its end or Ctrl-C; with a page, repeats its experiments until Ctrl-C.
pub(crate) fn run(args: &DemoArgs, is_json: bool) -> Result<Answer, CliError> {
    let settings = DemoSettings { out: args.out.clone(), force: args.force, quick: args.quick };
    let published = open(args)?.map(|publisher| Mutex::new(Published::new(publisher)));
    let stop = interrupt::listen()?;
    let watch = |name: &str, model: &LiveModel, shown: &TouchFrame<'_>| {
        if let Some(published) = &published {
            published.lock().unwrap_or_else(PoisonError::into_inner).take(name, model, shown);
        }
    };
    let watcher = published.is_some().then_some(&watch as &eit_report::demo::FrameWatcher<'_>);
    let mut answer = eit_report::demo::run(&settings, watcher, &stop, &mut progress::terminal())?;
    let Some(published) = published else { return Ok(answer) };
    let mut published = published.into_inner().unwrap_or_else(PoisonError::into_inner);
    if args.page.web.is_some() && !stop.is_set() {
        if !is_json {
            // now, not when the page is closed
            println!("{}", printable(&std::mem::take(&mut answer.text)));
        }
        eprintln!("eit: the page repeats both experiments; Ctrl-C ends it");
        published.repeat(&args.out, &stop)?;
    }
    published.end()?;
    Ok(answer)
}

/// Opens the requested outputs; `None` if there are none.
fn open(args: &DemoArgs) -> Result<Option<Publisher>, CliError> {
    if args.page.web.is_none() && !network::is_wanted(&args.network) {
        return Ok(None);
    }
    let mut publisher = network::open(&args.network, Publisher::new())?;
    if let Some(address) = &args.page.web {
        publisher = publish::open_page(address, publisher, false)?;
        let words =
            "The fabric and its touches are simulated first: they appear here in some seconds.";
        publisher.event(&Event::Notice(words.to_owned()))?;
    }
    Ok(Some(publisher))
}

/// Publishes the experiment that began last, since the experiments may overlap.
struct Published {
    publisher: Publisher,
    /// Names of the experiments so far, while the demo runs.
    experiments: Vec<String>,
    /// Number of experiments shown, repeated ones included.
    count: u32,
    failure: Option<CliError>,
}

impl Published {
    fn new(publisher: Publisher) -> Self {
        Self { publisher, experiments: Vec::new(), count: 0, failure: None }
    }

    fn take(&mut self, name: &str, model: &LiveModel, shown: &TouchFrame<'_>) {
        // the demo goes on where publishing failed; the end reports it
        if self.failure.is_none() {
            self.failure = self.publish(name, model, shown).err();
        }
    }

    fn publish(
        &mut self,
        name: &str,
        model: &LiveModel,
        shown: &TouchFrame<'_>,
    ) -> Result<(), CliError> {
        if !self.experiments.iter().any(|known| known == name) {
            self.experiments.push(name.to_owned());
            self.begin(name, model)?;
        } else if self.experiments.last().is_none_or(|last| last != name) {
            return Ok(());
        }
        self.frame(shown)
    }

    /// Begins an experiment.
    fn begin(&mut self, name: &str, model: &LiveModel) -> Result<(), CliError> {
        self.count += 1;
        self.publisher.skin(&publish::shape(model)?)?;
        Ok(self.publisher.start(&Start {
            skin: &model.skin().name,
            instrument: name,
            electrodes: model.skin().mesh.electrodes().len(),
            reference_frames: model.reference_frames,
            is_live: true,
        })?)
    }

    fn frame(&mut self, shown: &TouchFrame<'_>) -> Result<(), CliError> {
        let mut frame = *shown;
        // numbers of touches begin anew
        frame.epoch = self.count - 1;
        self.publisher.touches(&frame)?;
        publish::image(&mut self.publisher, shown)
    }

    /// Plays the recordings again and again until Ctrl-C.
    fn repeat(&mut self, folder: &Path, stop: &StopFlag) -> Result<(), CliError> {
        let scene = Scene::load(&folder.join("scene.toml").display().to_string())?;
        let model = LiveModel::from_scene(&scene, REFERENCE_FRAMES, &mut progress::terminal())?;
        let model = Arc::new(model);
        let quadruples = model.skin().protocol.quadruples();
        for (name, recording) in RECORDINGS.into_iter().cycle() {
            if stop.is_set() {
                break;
            }
            let mut replay = Replay::open(&folder.join(recording), quadruples, Pace::Speed(1.0))?;
            self.begin(name, &model)?;
            model.watch(&mut replay, false, &mut Repeated { published: self, stop })?;
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

/// Publishes a recording as it is played.
struct Repeated<'a> {
    published: &'a mut Published,
    stop: &'a StopFlag,
}

impl LiveObserver for Repeated<'_> {
    type Error = CliError;

    fn event(&mut self, event: &Event) -> Result<(), CliError> {
        Ok(self.published.publisher.event(event)?)
    }

    fn waiting(&mut self, left: usize) -> Result<(), CliError> {
        Ok(self.published.publisher.waiting(left)?)
    }

    fn frame(&mut self, shown: &TouchFrame<'_>) -> Result<(), CliError> {
        self.published.frame(shown)
    }

    fn wants_image(&self) -> bool {
        self.published.publisher.has_viewer()
    }

    fn goes_on(&mut self, _: &Summary) -> bool {
        !self.stop.is_set()
    }
}
