//! Hard cases: input on which programs of this kind break. Every case has an oracle that does not come from the code under test: a closed
//! form, exact arithmetic, an invariance, or a bound from the definition. `make bench-stability` writes them to docs/stability.md.

mod arithmetic;
mod files;
mod geometry;
mod levels;
mod pages;
mod placement;
mod values;
