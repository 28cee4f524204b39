//! `palpate chart`.

use std::path::Path;
use std::sync::Arc;

use miette::{IntoDiagnostic, Result, miette};

use crate::arguments::{ChartArguments, ChartName};
use crate::chart::{Chart, Settings, Work, compliance, haptics, plot, solvers, tissue};
use crate::output::{check_writable, make_folder, say};
use crate::stop::Stop;

/// Names the folder whose `reference` is taken unless the command line names one; without either nothing is compared.
const SHARED: &str = "PALPATE_SHARED";

pub(crate) fn chart(arguments: &ChartArguments) -> Result<u8> {
    let name = arguments.chart.name();
    // Before anything is made.
    let data = data(arguments)?;
    make_folder("--out", &arguments.out)?;
    let picture = arguments.out.join(format!("{name}.svg"));
    check_writable("--out", &picture)?;
    let settings = Settings { quick: arguments.quick, data };
    let stop = Stop::watch()?;
    let work = Work::new(Arc::clone(stop.flag()), arguments.quiet);
    // One core: what is compared are methods, not machines.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().into_diagnostic()?;
    let chart = pool.install(|| match arguments.chart {
        ChartName::Compliance => compliance::measure(&settings, &work),
        // Virtual time throughout: it takes all cores.
        ChartName::Haptics => haptics::measure(&settings, &work),
        ChartName::Solvers => solvers::measure(&settings, &work),
        ChartName::Tissue => tissue::measure(&settings, &work),
    })?;
    work.finish();
    let files = write(&chart, &picture, &arguments.out)?;
    for table in chart.tables.iter().filter(|table| !table.title.is_empty()) {
        say(format_args!("{}\n{}\n", table.title, table.table.screen()))?;
    }
    chart.notes.iter().try_for_each(|note| say(format_args!("note: {note}")))?;
    files.iter().try_for_each(|file| say(format_args!("wrote {file}")))?;
    Ok(if work.stopped() { stop.code() } else { 0 })
}

/// The folder of reference data: the one that was named must be there.
fn data(arguments: &ChartArguments) -> Result<Option<std::path::PathBuf>> {
    match &arguments.data {
        Some(folder) if !folder.is_dir() => Err(miette!(
            help = "leave --data out to measure without reference data",
            "--data {}: no such folder",
            folder.display()
        )),
        Some(folder) => Ok(Some(folder.clone())),
        None => {
            let shared = std::env::var_os(SHARED).map(|shared| Path::new(&shared).join("reference"));
            Ok(shared.filter(|folder| folder.is_dir()))
        }
    }
}

fn write(chart: &Chart, picture: &Path, out: &Path) -> Result<Vec<String>> {
    plot::draw(picture, &chart.title, &chart.panels, chart.layout)
        .map_err(|e| miette!("{}: {e}", picture.display()))?;
    let mut files = vec![picture.display().to_string()];
    for table in &chart.tables {
        let path = out.join(format!("{}.csv", table.file));
        table.table.write_csv(&path)?;
        files.push(path.display().to_string());
    }
    Ok(files)
}
