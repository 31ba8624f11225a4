//! Hard cases: what was measured is asserted here, and recorded for docs/stability.md when `LEAFCLOUD_STABILITY` names a file
//! (`make stability`). Each line of that file is a case in JSON.

use std::io::Write;

/// A hard case, and what decides it: something that does not come from the code under test.
pub struct Case {
    group: &'static str,
    name: &'static str,
    oracle: &'static str,
}

/// The greater of two errors; one that is not a number is the greatest of all.
pub fn worse(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::INFINITY } else { a.max(b) }
}

/// A case of a group, by name.
pub fn case(group: &'static str, name: &'static str, oracle: &'static str) -> Case {
    Case { group, name, oracle }
}

impl Case {
    /// The greatest error is at most what the oracle allows.
    pub fn holds(&self, worst: f64, allowed: f64) {
        let number = |x: f64| if x.is_finite() { format!("{x:e}") } else { "null".to_owned() };
        self.record(&format!(r#""worst": {}, "allowed": {}"#, number(worst), number(allowed)));
        assert!(worst <= allowed, "{} · {}: {worst:e}, allowed {allowed:e} ({})", self.group, self.name, self.oracle);
    }

    /// What must be equal is.
    #[allow(clippy::needless_pass_by_value)] // callers write values, not places
    pub fn equals<T: PartialEq + std::fmt::Debug>(&self, found: T, expected: T) {
        self.record(&format!(r#""worst": {}, "allowed": 0"#, u8::from(found != expected)));
        assert_eq!(found, expected, "{} · {} ({})", self.group, self.name, self.oracle);
    }

    /// There is no result, and the error says why.
    pub fn refuses<T, E: std::fmt::Display>(&self, found: Result<T, E>, naming: &str) {
        let message = found.err().map_or_else(|| "a result".to_owned(), |e| e.to_string());
        self.record(&format!(r#""error": {message:?}"#));
        assert!(message.contains(naming), "{} · {}: {message}, which does not name {naming:?}", self.group, self.name);
    }

    fn record(&self, outcome: &str) {
        let Ok(path) = std::env::var("LEAFCLOUD_STABILITY") else { return };
        let Self { group, name, oracle } = self;
        let line = format!("{{\"group\": {group:?}, \"name\": {name:?}, \"oracle\": {oracle:?}, {outcome}}}\n");
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(path).expect("a file to record in");
        // One write: lines of threads and processes do not mix.
        file.write_all(line.as_bytes()).expect("the record is written");
    }
}
