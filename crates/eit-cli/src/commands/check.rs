//! `eit check`: whether the instrument is ready for use, and what to try if not.

use super::{Answer, Ended, FAULTY};
use crate::cli::CheckArgs;
use crate::error::CliError;
use crate::progress;
use eit_hw::driver::Statistics;
use eit_hw::{
    HealthReport, ReferenceFrames, Resolution, Severity, Verdict, measure_reference_frames,
};
use eit_skin::Skin;
use eit_skin::connect::{self, Backlog};
use eit_skin::health;
use eit_skin::scene::Scene;
use serde_json::{Value, json};
use std::time::Duration;

/// Measures frames of the untouched skin and checks their health.
pub(crate) fn run(args: &CheckArgs) -> Result<Ended, CliError> {
    if !(args.seconds > 0.0 && args.seconds <= 3600.0) {
        let message = format!("--seconds {}: it must be above 0, to 3600", args.seconds);
        return Err(CliError::input(message));
    }
    if args.frames < HealthReport::LEAST_FRAMES {
        let (frames, least) = (args.frames, HealthReport::LEAST_FRAMES);
        let message = format!("--frames {frames}: it must be at least {least}, to tell the noise");
        return Err(CliError::input(message));
    }
    let scene = Scene::load(&args.scene)?;
    let instrument = scene.instrument()?;
    let mut progress = progress::terminal();
    let mut session = progress
        .stage("connect", || connect::open(&instrument, args.port.as_deref(), Backlog::Recorded))?;
    let limit = Duration::from_secs_f64(args.seconds);
    let quiet = progress.stage("measure: do not touch the skin", || {
        measure_reference_frames(&mut session, args.frames, limit)
    })?;
    let statistics = session.statistics();
    session.stop();
    let found = quiet.frames.values.nrows();
    let name = session.setup().identity.to_string();
    if found == 0 {
        return Err(CliError::Silent(format!(
            "{name}: no frame within {} s, {} bytes in total: check its power and cable, and that its \
             scan is running",
            args.seconds, statistics.bytes
        )));
    }
    let mut report = health::check(&quiet, &instrument).map_err(|error| {
        CliError::Failure(format!(
            "{found} frames within {} s, {} bytes in total: {error}",
            args.seconds, statistics.bytes
        ))
    })?;
    // a scene whose skin cannot be modelled here, such as one that stores charge, can be checked nevertheless
    if let Ok(skin) = Skin::set_up(&scene, &Default::default(), &mut progress) {
        health::check_model(&mut report, &quiet, &skin)?;
    }
    let answer = Answer {
        text: text(&name, &report, &quiet, &statistics),
        json: to_json(&name, &report, &quiet, &statistics),
    };
    let exit_code = if report.verdict() == Verdict::Faulty { FAULTY } else { 0 };
    Ok(Ended { answer, exit_code })
}

fn verdict(report: &HealthReport) -> &'static str {
    match report.verdict() {
        Verdict::Good => "good",
        Verdict::Usable => "usable",
        Verdict::Faulty => "faulty",
    }
}

fn severity(severity: Severity) -> &'static str {
    match severity {
        Severity::Warning => "warning",
        Severity::Fault => "fault",
    }
}

fn text(
    name: &str,
    report: &HealthReport,
    quiet: &ReferenceFrames,
    statistics: &Statistics,
) -> String {
    let number = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "unknown".to_owned(), |value| format!("{value:.digits$}"))
    };
    let mut lines = vec![
        format!("{name}: {}", verdict(report)),
        format!(
            "{} frames at {} Hz, {} lost, {} bytes damaged; signal-to-noise ratio {}, reciprocity \
             error {}",
            quiet.frames.values.nrows(),
            number(report.frame_rate_hz, 2),
            quiet.facts.lost_frames,
            statistics.damaged_bytes,
            report
                .signal_to_noise_db
                .map_or_else(|| "unknown".to_owned(), |db| format!("{db:.1} dB")),
            number(report.reciprocity, 3),
        ),
    ];
    if let Some(Resolution { step, steps_per_touch, still }) = &report.resolution {
        lines.push(format!(
            "resolution {step:.2e}: a change of 1 % is {steps_per_touch:.1} steps; {still} of {} \
             measurements never change",
            report.noise_std.len()
        ));
    }
    let findings = report.findings.iter();
    lines.extend(findings.map(|finding| format!("{}: {finding}", severity(finding.severity))));
    if report.findings.is_empty() {
        lines.push("no faults found".to_owned());
    }
    lines.extend(quiet.notices.iter().map(|notice| format!("notice of the instrument: {notice}")));
    lines.join("\n")
}

fn to_json(
    name: &str,
    report: &HealthReport,
    quiet: &ReferenceFrames,
    statistics: &Statistics,
) -> Value {
    let findings: Vec<Value> = report
        .findings
        .iter()
        .map(|finding| {
            json!({
                "severity": severity(finding.severity),
                // numbered from 1, as in the text
                "electrode": finding.electrode.map(|electrode| electrode + 1),
                "what": finding.to_string(),
                "try": finding.advice(),
            })
        })
        .collect();
    json!({
        "instrument": name,
        "verdict": verdict(report),
        "frames": quiet.frames.values.nrows(),
        "frame_rate_hz": report.frame_rate_hz,
        "lost_frames": quiet.facts.lost_frames,
        "damaged_bytes": statistics.damaged_bytes,
        "signal_to_noise_db": report.signal_to_noise_db,
        "reciprocity_error": report.reciprocity,
        "resolution": report.resolution.map(|resolution| json!({
            "step": resolution.step,
            "steps_per_touch": resolution.steps_per_touch,
            "still_measurements": resolution.still,
        })),
        "findings": findings,
        "notices": quiet.notices,
    })
}
