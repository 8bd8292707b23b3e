//! The file that Python imports: the border, linked. A crate of its own, so that the border is compiled beside the core.

pub use softpinch_py::_core;
