//! The table and the JSON of the bench.

use std::fmt::Write as _;

use leafcloud::Cloud;

use crate::machine::Roofline;

/// Means over the seeds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Figure {
    pub billboards: f64,
    pub seconds: f64,
    /// The share of area that projection keeps.
    pub kept: f64,
    /// Mean deviation as a share of ε = 0.04.
    pub deviation: f64,
    /// Area of the outlines, R².
    pub drawn: f64,
}

impl Figure {
    pub fn add(&mut self, other: &Self) {
        self.billboards += other.billboards;
        self.seconds += other.seconds;
        self.kept += other.kept;
        self.deviation += other.deviation;
        self.drawn += other.drawn;
    }

    pub fn over(self, count: f64) -> Self {
        Self {
            billboards: self.billboards / count,
            seconds: self.seconds / count,
            kept: self.kept / count,
            deviation: self.deviation / count,
            drawn: self.drawn / count,
        }
    }

    fn json(&self) -> String {
        let Self { billboards, seconds, kept, deviation, drawn } = self;
        format!(
            "{{\"billboards\": {billboards:.2}, \"seconds\": {seconds:.5}, \"kept_share\": {kept:.4}, \
             \"mean_deviation\": {deviation:.4}, \"outline_area\": {drawn:.3}}}"
        )
    }
}

/// Figures of one tree: the literal algorithm, and the variants compared with it.
pub struct Row {
    name: String,
    triangles: usize,
    literal: Figure,
    ours: Vec<(&'static str, Figure)>,
    /// The fewest billboards found, the seconds for that, and a lower bound.
    pub best: Option<(usize, f64, usize)>,
}

impl Row {
    pub fn push(&mut self, name: &'static str, figure: Figure) {
        self.ours.push((name, figure));
    }
}

struct Large {
    name: String,
    triangles: usize,
    billboards: usize,
    seconds: f64,
}

#[derive(Default)]
pub struct Report {
    rows: Vec<Row>,
    larges: Vec<Large>,
    /// Tree, variant, its figures, figures of the literal algorithm.
    transparency: Vec<(String, String, Figure, Figure)>,
    pub peak_bytes_per_triangle: Option<f64>,
    pub roofline: Option<Roofline>,
}

impl Report {
    pub fn row(&mut self, name: &str, triangles: usize, literal: Figure) -> &mut Row {
        self.rows.push(Row { name: name.to_owned(), triangles, literal, ours: Vec::new(), best: None });
        self.rows.last_mut().expect("one was just pushed")
    }

    pub fn large(&mut self, name: &str, triangles: usize, (cloud, seconds): (Cloud, f64)) {
        self.larges.push(Large { name: name.to_owned(), triangles, billboards: cloud.planes.len(), seconds });
    }

    pub fn transparency(&mut self, tree: &str, what: &str, figure: Figure, literal: Figure) {
        self.transparency.push((tree.to_owned(), what.to_owned(), figure, literal));
    }

    fn print_transparency(&self) {
        println!("## The cost of transparency\n");
        println!(
            "Effort \"default\" against literal with rectangles, means over the trees. Overdraw is the area of the outlines, since the covered area is the same.\n"
        );
        println!("| variant | overdraw × | billboards × | deviation × |\n|---|---|---|---|");
        let mut kinds: Vec<&String> = Vec::new();
        for (_, what, ..) in &self.transparency {
            if !kinds.contains(&what) {
                kinds.push(what);
            }
        }
        for kind in kinds {
            let rows: Vec<_> = self.transparency.iter().filter(|row| row.1 == *kind).collect();
            let mean = |part: fn(&Figure) -> f64| {
                rows.iter().map(|r| part(&r.2) / part(&r.3)).sum::<f64>() / rows.len() as f64
            };
            println!(
                "| {kind} | {:.2} | {:.2} | {:.2} |",
                mean(|f| f.drawn),
                mean(|f| f.billboards),
                mean(|f| f.deviation)
            );
        }
        println!();
    }

    pub fn print(&self) {
        let Some(first) = self.rows.first() else {
            println!("no trees to measure: put them into shared/foliage beside the repository");
            return;
        };
        println!(
            "Made by `make bench`. ε = 0.04 R, means of 5 seeds. Literal is Algorithm 1 with N = 600 on one thread.\n"
        );
        println!("## Against literal: billboards ×, seconds × (share of area kept)\n");
        let names: Vec<&str> = first.ours.iter().map(|(name, _)| *name).collect();
        println!("| tree | triangles | literal | {} |", names.join(" | "));
        println!("|---|---|---|{}", "---|".repeat(names.len()));
        for Row { name, triangles, literal, ours, .. } in &self.rows {
            let Figure { billboards, seconds, kept, .. } = literal;
            let cell = |(_, f): &(_, Figure)| {
                format!("{:.2} ×, {:.2} × ({:.2})", f.billboards / billboards, f.seconds / seconds, f.kept)
            };
            let cells: Vec<String> = ours.iter().map(cell).collect();
            println!("| {name} | {triangles} | {billboards:.1}, {seconds:.3} s ({kept:.2}) | {} |", cells.join(" | "));
        }
        let means: Vec<String> = (0..names.len())
            .map(|i| {
                let mean = |f: &dyn Fn(&Figure, &Figure) -> f64| {
                    self.rows.iter().map(|r| f(&r.ours[i].1, &r.literal)).sum::<f64>() / self.rows.len() as f64
                };
                let (count, time) = (mean(&|a, b| a.billboards / b.billboards), mean(&|a, b| a.seconds / b.seconds));
                format!("**{count:.3} ×, {time:.3} ×**")
            })
            .collect();
        println!("| mean | | | {} |\n", means.join(" | "));
        self.print_shape(&names);
        self.print_transparency();
        self.print_best();
        self.print_large();
        self.print_roofline();
    }

    fn print_shape(&self, names: &[&str]) {
        println!("## Against literal: mean deviation ×, overdraw ×\n");
        println!("Outlines of 8 corners around opaque parts against literal's rectangles around everything.\n");
        println!("| tree | literal: deviation / ε, outlines / R² | {} |", names.join(" | "));
        println!("|---|---|{}", "---|".repeat(names.len()));
        let ratio = |a: &Figure, b: &Figure| (a.deviation / b.deviation, a.drawn / b.drawn);
        for Row { name, literal, ours, .. } in &self.rows {
            let cell = |(_, f): &(_, Figure)| format!("{:.2} ×, {:.2} ×", ratio(f, literal).0, ratio(f, literal).1);
            let cells: Vec<String> = ours.iter().map(cell).collect();
            println!("| {name} | {:.2}, {:.1} | {} |", literal.deviation, literal.drawn, cells.join(" | "));
        }
        let means: Vec<String> = (0..names.len())
            .map(|i| {
                let sum = self
                    .rows
                    .iter()
                    .map(|r| ratio(&r.ours[i].1, &r.literal))
                    .fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
                format!("**{:.3} ×, {:.3} ×**", sum.0 / self.rows.len() as f64, sum.1 / self.rows.len() as f64)
            })
            .collect();
        println!("| mean | | {} |\n", means.join(" | "));
    }

    fn print_best(&self) {
        println!("## The fewest found\n");
        println!("Effort \"best\", seed 0. The lower bound follows from the most triangles that a plane holds.\n");
        println!("| tree | billboards | against literal | seconds | lower bound |\n|---|---|---|---|---|");
        for row in &self.rows {
            if let Some((count, seconds, bound)) = row.best {
                println!(
                    "| {} | {count} | {:.2} × | {seconds:.1} | {bound} |",
                    row.name,
                    count as f64 / row.literal.billboards
                );
            }
        }
        println!();
    }

    fn print_large(&self) {
        println!(
            "## Large foliage\n\n| foliage | triangles | billboards | seconds | ns per triangle |\n|---|---|---|---|---|"
        );
        for Large { name, triangles, billboards, seconds } in &self.larges {
            println!(
                "| {name} | {triangles} | {billboards} | {seconds:.2} | {:.0} |",
                seconds / *triangles as f64 * 1e9
            );
        }
        if let Some(bytes) = self.peak_bytes_per_triangle {
            println!("\nPeak memory of the whole process in the largest fit: {bytes:.0} bytes per triangle.");
        }
        println!();
    }

    fn print_roofline(&self) {
        let Some(r) = self.roofline else { return };
        println!("## Roofline of the sweep, one core\n");
        println!(
            "{:.1} of {:.1} billion multiply-adds per second ({:.0} %), {:.1} of {:.1} GB/s ({:.0} %), {:.2} of {:.2} billion bins changed per \
             second ({:.0} %), two for each piece and direction. The rest of the time goes into the arithmetic of intervals and into \
             extracting lanes from registers.",
            r.sweep / 1e9,
            r.peak / 1e9,
            r.sweep / r.peak * 100.0,
            r.bytes / 1e9,
            r.bandwidth / 1e9,
            r.bytes / r.bandwidth * 100.0,
            r.updates / 1e9,
            r.most_updates / 1e9,
            r.updates / r.most_updates * 100.0
        );
    }

    /// Writes the JSON to the file that `LEAFCLOUD_BENCH_JSON` names, if it is set.
    pub fn save(&self) {
        let Ok(path) = std::env::var("LEAFCLOUD_BENCH_JSON") else { return };
        let mut json = String::from("{\n  \"trees\": [\n");
        for (i, row) in self.rows.iter().enumerate() {
            let ours: Vec<String> =
                row.ours.iter().map(|(name, f)| format!("      \"{name}\": {}", f.json())).collect();
            let (count, seconds, bound) = row.best.unwrap_or_default();
            let comma = if i + 1 < self.rows.len() { "," } else { "" };
            let _ = writeln!(
                json,
                "    {{\n      \"tree\": \"{}\", \"triangles\": {},\n      \"literal\": {},\n{},\n      \"best\": \
                 {{\"billboards\": {count}, \"seconds\": {seconds:.2}, \"lower_bound\": {bound}}}\n    }}{comma}",
                row.name,
                row.triangles,
                row.literal.json(),
                ours.join(",\n")
            );
        }
        let large = |l: &Large| {
            format!(
                "    {{\"foliage\": \"{}\", \"triangles\": {}, \"billboards\": {}, \"seconds\": {:.3}}}",
                l.name, l.triangles, l.billboards, l.seconds
            )
        };
        let larges: Vec<String> = self.larges.iter().map(large).collect();
        let _ = write!(json, "  ],\n  \"large\": [\n{}\n  ]", larges.join(",\n"));
        if let Some(bytes) = self.peak_bytes_per_triangle {
            let _ = write!(json, ",\n  \"peak_bytes_per_triangle\": {bytes:.1}");
        }
        if let Some(r) = self.roofline {
            let _ = write!(
                json,
                ",\n  \"roofline\": {{\"sweep_madds\": {:.3e}, \"peak_madds\": {:.3e}, \"sweep_bytes\": {:.3e}, \"bandwidth\": {:.3e}, \
                 \"bins_changed\": {:.3e}, \"most_bins_changed\": {:.3e}}}",
                r.sweep, r.peak, r.bytes, r.bandwidth, r.updates, r.most_updates
            );
        }
        json.push_str("\n}\n");
        std::fs::write(&path, json).unwrap_or_else(|e| panic!("{path} cannot be written: {e}"));
    }
}
