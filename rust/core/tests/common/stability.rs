//! Assertions for hard cases. With `LEAFCLOUD_STABILITY` set to a file, they also record each case there for docs/stability.md
//! (`make bench-stability`), as a line of JSON.

use std::io::Write;

/// A hard case and its oracle, the reference for the result, which does not come from the code under test.
pub struct Case {
    group: &'static str,
    name: &'static str,
    oracle: &'static str,
}

/// Returns the greater of two errors; NaN counts as infinite.
pub fn worse(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::INFINITY } else { a.max(b) }
}

/// Returns a case of a group.
pub fn case(group: &'static str, name: &'static str, oracle: &'static str) -> Case {
    Case { group, name, oracle }
}

impl Case {
    /// Asserts that the greatest error is at most the allowed one.
    pub fn holds(&self, worst: f64, allowed: f64) {
        let number = |x: f64| if x.is_finite() { format!("{x:e}") } else { "null".to_owned() };
        self.record(&format!(r#""worst": {}, "allowed": {}"#, number(worst), number(allowed)));
        assert!(worst <= allowed, "{} · {}: {worst:e}, allowed {allowed:e} ({})", self.group, self.name, self.oracle);
    }

    /// Asserts that the result equals the expected one.
    #[allow(clippy::needless_pass_by_value)] // callers pass temporary values
    pub fn equals<T: PartialEq + std::fmt::Debug>(&self, found: T, expected: T) {
        self.record(&format!(r#""worst": {}, "allowed": 0"#, u8::from(found != expected)));
        assert_eq!(found, expected, "{} · {} ({})", self.group, self.name, self.oracle);
    }

    /// Asserts that there is no result, and that the error message contains `naming`.
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
        // A single write keeps lines of threads and processes apart.
        file.write_all(line.as_bytes()).expect("the record is written");
    }
}
