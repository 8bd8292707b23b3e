//! The examples of the crate's documentation and of its README. They are compiled here, because tests of documentation
//! would compile the whole crate once more.

/// The code of the first block of a text, without the marks of comments and of hidden lines, and without indentation.
fn code(text: &str, fence: &str) -> Vec<String> {
    let lines =
        text.lines().skip_while(|line| *line != fence).skip(1).take_while(|line| !line.ends_with("```"));
    let bare = |line: &str| line.trim_start_matches("//!").trim().trim_start_matches("# ").to_owned();
    lines.map(bare).filter(|line| !line.is_empty()).collect()
}

/// The same of an example, whose first line is a comment, and whose function is public for these tests.
fn example(text: &str) -> Vec<String> {
    text.lines()
        .skip(1)
        .map(|line| line.trim().trim_start_matches("pub(crate) ").to_owned())
        .filter(|line| !line.is_empty())
        .collect()
}

#[path = "../../examples/operation_1.rs"]
mod operation_1;
#[path = "../../examples/readme.rs"]
mod readme;

#[test]
fn the_example_of_the_readme_runs() {
    readme::main().unwrap();
    let (text, own) = (include_str!("../../README.md"), include_str!("../../examples/readme.rs"));
    assert_eq!(code(text, "```rust"), example(own));
}

#[test]
fn the_example_of_the_documentation_runs() {
    operation_1::main().unwrap();
    let shown = code(include_str!("../lib.rs"), "//! ```");
    let own = example(include_str!("../../examples/operation_1.rs"));
    // The documentation has no function around it.
    let inner: Vec<_> = own.into_iter().filter(|line| !line.starts_with("fn ") && line != "}").collect();
    assert_eq!(shown[..shown.len() - 1], inner[..inner.len() - 1]);
    assert_eq!(shown.last().map(String::as_str), Some("Ok::<(), Error>(())"));
}
