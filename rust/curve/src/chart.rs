//! Charts of error over cost on logarithmic axes, as SVG or pixels.

use std::sync::Once;

use leafcloud::Image;
use leafcloud::error::{Error, Result};
use leafcloud::fit::Named;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use crate::front::front;
use crate::sweep::Point;
use crate::within::{Offer, Preset};

/// Cost on the horizontal axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cost {
    /// Seconds to build the whole chain.
    Seconds,
    /// Billboards on level 1.
    Billboards,
    /// Graphics memory of all levels.
    Bytes,
}

impl Cost {
    /// All costs.
    pub const ALL: [Self; 3] = [Self::Seconds, Self::Billboards, Self::Bytes];

    /// Returns the name in settings and files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Seconds => "seconds",
            Self::Billboards => "billboards",
            Self::Bytes => "bytes",
        }
    }

    /// Returns the cost with this name.
    ///
    /// # Errors
    /// An unknown name.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|cost| cost.name() == name).ok_or_else(|| {
            Error::invalid(format!("cost {name:?} is unknown; choose one of: seconds, billboards, bytes"))
        })
    }

    const fn label(self) -> &'static str {
        match self {
            Self::Seconds => "time to build all levels (s)",
            Self::Billboards => "billboards on level 1 (count)",
            Self::Bytes => "graphics memory of all levels (MiB)",
        }
    }

    fn of(self, point: &Point) -> f64 {
        match self {
            Self::Seconds => point.seconds.total(),
            Self::Billboards => point.billboards as f64,
            Self::Bytes => point.bytes as f64 / f64::from(1 << 20),
        }
    }
}

/// A series of points.
#[derive(Clone, Debug)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// (cost, error), all above 0, in any order.
    pub points: Vec<(f64, f64)>,
}

/// Content of a chart.
#[derive(Clone, Debug)]
pub struct Chart {
    title: String,
    /// Labels of the horizontal and vertical axis.
    axes: [&'static str; 2],
    series: Vec<Series>,
    /// Points with a name beside them.
    named: Vec<((f64, f64), &'static str)>,
}

/// Size of a chart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChartSize {
    /// Width in pixels, in [240, 8192].
    pub width: u32,
    /// Height in pixels, in [240, 8192].
    pub height: u32,
    /// Scale of text and lines, in [0.5, 4]: 1 suits a printed page; use more if the chart is shown small.
    pub text: f64,
}

/// Label of the error axis.
const ERROR: &str = "image error (mean FLIP, 0 to 1)";

const SIDES: std::ops::RangeInclusive<u32> = 240..=8192;
const TEXTS: std::ops::RangeInclusive<f64> = 0.5..=4.0;

impl Chart {
    /// Returns a chart of measured points, with a line for each method. It leaves out points that were measured on fewer leaves.
    #[must_use]
    pub fn of_points(title: &str, points: &[Point], cost: Cost) -> Self {
        let mut series: Vec<Series> = Vec::new();
        let most = points.iter().map(|p| p.measured_on).max().unwrap_or(0);
        for point in points.iter().filter(|p| p.measured_on == most) {
            let name = point.choice.method.name();
            let place = (cost.of(point), point.image_error.max(1e-3));
            match series.iter_mut().find(|series| series.name == name) {
                Some(series) => series.points.push(place),
                None => series.push(Series { name: name.to_owned(), points: vec![place] }),
            }
        }
        Self { title: title.to_owned(), axes: [cost.label(), ERROR], series, named: Vec::new() }
    }

    /// Returns a chart of the predictions for all leaves, with the presets by name. It is for a panel and has short labels and no legend.
    #[must_use]
    pub fn of_offers(title: &str, offers: &[Offer]) -> Self {
        let place = |offer: &Offer| (offer.predicted.seconds, offer.predicted.image_error.max(1e-3));
        let named =
            Preset::ALL.into_iter().filter_map(|preset| Some((place(preset.of(offers)?), preset.name()))).collect();
        let series = vec![Series { name: "predicted".to_owned(), points: offers.iter().map(place).collect() }];
        Self { title: title.to_owned(), axes: ["seconds to build", "image error (FLIP)"], series, named }
    }

    /// Returns the chart as the text of an SVG file.
    ///
    /// # Errors
    /// A size out of range; no points.
    pub fn svg(&self, size: ChartSize) -> Result<String> {
        self.check(size)?;
        let mut text = String::new();
        self.draw(&SVGBackend::with_string(&mut text, (size.width, size.height)).into_drawing_area(), size.text)?;
        Ok(text)
    }

    /// Returns the chart as an image.
    ///
    /// # Errors
    /// A size out of range; no points.
    pub fn picture(&self, size: ChartSize) -> Result<Image> {
        self.check(size)?;
        let ChartSize { width, height, text } = size;
        let mut codes = vec![255u8; (3 * width * height) as usize];
        let scale = (f64::from(width.min(height * 3 / 2)) / 720.0).max(0.5);
        self.draw(&BitMapBackend::with_buffer(&mut codes, (width, height)).into_drawing_area(), scale * text)?;
        let pixels = codes.as_chunks::<3>().0.iter().map(|&[r, g, b]| [r, g, b, 255]).collect::<Vec<_>>();
        Image::new(width as usize, height as usize, pixels)
    }

    fn check(&self, size: ChartSize) -> Result<()> {
        if let Some(side) = [size.width, size.height].into_iter().find(|side| !SIDES.contains(side)) {
            return Err(Error::invalid(format!("a side of the chart has {side} pixels; it must have 240 to 8192")));
        }
        if !TEXTS.contains(&size.text) {
            return Err(Error::invalid(format!(
                "the text scale of the chart is {}; it must be from 0.5 to 4",
                size.text
            )));
        }
        if self.all().next().is_none() {
            return Err(Error::invalid("the chart has no points; measure some first"));
        }
        Ok(())
    }

    fn all(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.series.iter().flat_map(|series| series.points.iter().copied())
    }

    /// Draws the chart. `scale` is the scale of text and lines.
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, scale: f64) -> Result<()> {
        load_font();
        self.try_draw(area, scale).map_err(|error| Error::invalid(format!("the chart cannot be drawn: {error}")))
    }

    fn try_draw<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
        scale: f64,
    ) -> std::result::Result<(), DrawingAreaErrorKind<B::ErrorType>> {
        let text = |size: f64| (FONT, size * scale).into_font().color(&INK);
        let size = |pixels: f64| (pixels * scale).round().max(1.0) as u32;
        area.fill(&WHITE)?;
        let (width, height) = area.dim_in_pixel();
        let for_names = if self.named.is_empty() { 0.0 } else { ROOM_FOR_NAMES };
        let across = Axis::around(self.all().map(|p| p.0), for_names, (f64::from(width) / (90.0 * scale)) as usize);
        let up = Axis::around(self.all().map(|p| p.1), 0.0, (f64::from(height) / (50.0 * scale)) as usize);
        let mut chart = ChartBuilder::on(area)
            .caption(&self.title, text(20.0))
            .margin(size(14.0))
            .margin_right(size(24.0))
            .x_label_area_size(size(52.0))
            .y_label_area_size(size(80.0))
            .build_cartesian_2d(across, up)?;
        chart
            .configure_mesh()
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .x_desc(self.axes[0])
            .y_desc(self.axes[1])
            .label_style(text(14.0))
            .axis_desc_style(text(15.0))
            .axis_style(INK)
            .draw()?;
        let ring = ShapeStyle { color: INK.to_rgba(), filled: false, stroke_width: size(2.0) };
        for (series, color) in self.series.iter().zip(COLORS.iter().cycle()) {
            let line = front_of(&series.points).into_iter().map(logs);
            let (radius, line_width) = (size(4.0) as i32, size(2.0));
            chart.draw_series(LineSeries::new(line, color.stroke_width(line_width)))?;
            let dots = series.points.iter().map(|&p| Circle::new(logs(p), radius, color.filled()));
            chart
                .draw_series(dots)?
                .label(&series.name)
                .legend(move |(x, y)| Circle::new((x + 10, y), radius, color.filled()));
        }
        let radius = size(7.0) as i32;
        if self.named.is_empty() {
            let on_front = front_of(&self.all().collect::<Vec<_>>());
            chart
                .draw_series(on_front.into_iter().map(|p| Circle::new(logs(p), radius, ring)))?
                .label("Pareto front")
                .legend(move |(x, y)| Circle::new((x + 10, y), radius, ring));
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::UpperRight)
                .background_style(WHITE.mix(0.85))
                .border_style(GRID)
                .label_font(text(14.0))
                .draw()?;
        }
        let mut taken: Vec<[i32; 4]> = Vec::new();
        for (place, name) in &self.named {
            let at = chart.backend_coord(&logs(*place));
            let (wide, high) = area.estimate_text_size(name, &text(15.0))?;
            let beside = beside(at, [wide as i32, high as i32], radius, &taken);
            taken.push([beside.0, beside.1, beside.0 + wide as i32, beside.1 + high as i32]);
            area.draw(&Circle::new(at, radius, ring))?;
            area.draw(&Text::new(*name, beside, text(15.0)))?;
        }
        area.present()
    }
}

/// Space to the right of the points, as a share of their extent.
const ROOM_FOR_NAMES: f64 = 0.4;

/// Returns the upper left corner of a name of this size at a point of a falling line: to the right and above, where the line is not, and
/// above all rectangles in `taken` (left, top, right, bottom).
fn beside((x, y): (i32, i32), [wide, high]: [i32; 2], gap: i32, taken: &[[i32; 4]]) -> (i32, i32) {
    let left = x + gap;
    let mut top = y - gap - high;
    let overlaps = |o: &[i32; 4], top: i32| {
        left < o[2] + gap && o[0] < left + wide + gap && top < o[3] + gap && o[1] < top + high + gap
    };
    while let Some(other) = taken.iter().find(|other| overlaps(other, top)) {
        top = other[1] - high - gap;
    }
    (left, top)
}

const FONT: &str = "DejaVu Sans, sans-serif";
const INK: RGBColor = RGBColor(40, 40, 40);
const GRID: RGBColor = RGBColor(222, 222, 222);

/// Colors that color-blind people can tell apart (Okabe and Ito).
const COLORS: [RGBColor; 4] =
    [RGBColor(0, 114, 178), RGBColor(230, 159, 0), RGBColor(0, 158, 115), RGBColor(204, 121, 167)];

fn load_font() {
    static LOADED: Once = Once::new();
    LOADED.call_once(|| {
        let loaded = register_font(FONT, FontStyle::Normal, dejavu::sans::regular());
        assert!(loaded.is_ok(), "the built-in font is valid");
    });
}

/// Returns the points on the Pareto front, by cost.
fn front_of(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut on: Vec<(f64, f64)> = points.iter().zip(front(points)).filter(|(_, on)| *on).map(|(p, _)| *p).collect();
    on.sort_by(|a, b| a.0.total_cmp(&b.0));
    on
}

fn logs((x, y): (f64, f64)) -> (f64, f64) {
    (x.log10(), y.log10())
}

/// Returns a tick's value as a short decimal number.
fn written(log: f64) -> String {
    let value = 10f64.powf(log);
    let digits = (-value.log10().floor()).max(0.0) as usize;
    let short = format!("{value:.digits$}");
    let exact = short.parse().is_ok_and(|short: f64| (short / value - 1.0).abs() < 0.01);
    if exact { short } else { format!("{value:.0$}", digits + 1) }
}

/// A logarithmic axis: its range and its ticks, all as decimal logarithms.
struct Axis {
    low: f64,
    high: f64,
    ticks: Vec<f64>,
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (start, end): (i32, i32)) -> i32 {
        start + ((value - self.low) / (self.high - self.low) * f64::from(end - start)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        // Ticks between the labeled ones are not drawn.
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for Axis {
    fn format(value: &f64) -> String {
        written(*value)
    }
}

impl Axis {
    /// Returns an axis with at most about `most` ticks and a margin around the values, wider by `more` of their extent after the greatest.
    fn around(values: impl Iterator<Item = f64>, more: f64, most: usize) -> Self {
        let (low, high) =
            values.map(f64::log10).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let room = (0.08 * (high - low)).max(0.06);
        let mut axis = Self { low: low - room, high: high + room + more * (high - low), ticks: Vec::new() };
        axis.ticks = axis.ticks(most);
        axis
    }

    /// Returns the finest of the usual series with at most `most` ticks; the coarsest is powers of ten.
    fn ticks(&self, most: usize) -> Vec<f64> {
        let series: [&[f64]; 4] =
            [&[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0], &[1.0, 2.0, 3.0, 5.0, 7.0], &[1.0, 2.0, 5.0], &[1.0]];
        let ticks = |steps: &[f64]| -> Vec<f64> {
            let decades = self.low.floor() as i32..=self.high.ceil() as i32;
            let all = decades.flat_map(|decade| steps.iter().map(move |step| f64::from(decade) + step.log10()));
            all.filter(|tick| (self.low..=self.high).contains(tick)).collect()
        };
        series.into_iter().map(ticks).find(|ticks| ticks.len() <= most).unwrap_or_else(|| ticks(&[1.0]))
    }
}
