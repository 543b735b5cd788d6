//! Compares our multifrontal Cholesky factorisation with faer's sparse one: the system matrix of
//! the disc at about 2 000 and 20 000 nodes, one factorisation and one solve with 15 current
//! patterns, on one thread.
//!
//! Both reuse their memory. faer runs with its own elimination order and with ours. Our solver
//! exploits right-hand sides that are zero on all nodes and performs only the backward sweep; faer
//! solves for arbitrary ones.
#![allow(clippy::expect_used, reason = "a stage that fails must end the bench, not be timed")]

use benches::Result;
use benches::faer_cholesky::{COLUMNS, FaerCholesky, Order};
use benches::problem::{self, currents};
use criterion::{BenchmarkId, Criterion, SamplingMode};
use eit_fem::sparse::Cholesky;
use eit_mesh::generate;
use faer::Mat;
use std::time::Duration;

fn main() -> Result<()> {
    let mut criterion = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2))
        .configure_from_args();
    for nodes in [2000, 20000] {
        let (shape, electrodes) = problem::disc();
        let mesh = generate(&shape, &electrodes, &problem::mesh_settings(nodes)?)?;
        let model = problem::model(&mesh)?;
        let matrix = model.system_matrix(&problem::conductivity(model.elements()))?;
        let mut group = criterion.benchmark_group("cholesky");
        group.sampling_mode(SamplingMode::Flat);

        let cholesky = Cholesky::new(&matrix.pattern, matrix.nodes)?;
        let mut factor = cholesky.memory()?;
        group.bench_function(BenchmarkId::new("ours: factorise", nodes), |b| {
            b.iter(|| cholesky.factorise(&matrix.values, &mut factor, 1.0).expect("a factor"));
        });
        let unknowns = matrix.pattern.unknowns();
        let mut x = vec![0.0; unknowns * COLUMNS];
        group.bench_function(BenchmarkId::new("ours: 15 right-hand sides", nodes), |b| {
            b.iter(|| {
                for (row, currents) in
                    x[matrix.nodes * COLUMNS..].chunks_exact_mut(COLUMNS).zip(currents())
                {
                    row.copy_from_slice(&currents);
                }
                cholesky.solve(&mut factor, &mut x, COLUMNS).expect("a solution");
            });
        });
        for (name, order) in [("faer", Order::Own), ("faer in our order", Order::Given)] {
            let mut faer = FaerCholesky::new(&matrix, order)?;
            group.bench_function(BenchmarkId::new(format!("{name}: factorise"), nodes), |b| {
                b.iter(|| faer.factorise(&matrix.values).expect("a factor"));
            });
            faer.factorise(&matrix.values)?;
            let mut x = Mat::zeros(unknowns, COLUMNS);
            let name = format!("{name}: 15 right-hand sides");
            group.bench_function(BenchmarkId::new(name, nodes), |b| {
                b.iter(|| {
                    x.fill(0.0);
                    for (k, currents) in currents().enumerate() {
                        (0..COLUMNS).for_each(|c| x[(matrix.nodes + k, c)] = currents[c]);
                    }
                    faer.solve(x.as_mut());
                });
            });
        }
        group.finish();
    }
    criterion.final_summary();
    Ok(())
}
