//! Writes an HTML page with no scripts and no network access. Its main pictures are embedded; large ones and movies are
//! files beside it, which the browser reads when they come into view or are opened.
//!
//! The file can be opened directly. A browser without style sheets still shows headings, pictures
//! and tables in order.

use crate::error::ReportError;
use crate::output::io;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use std::io::Write;

/// Follows the reader's light or dark setting; tables scroll on narrow screens instead of widening
/// the page; pictures keep a white background.
const STYLE: &str = "
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { line-height: 1.2; } h2 { margin-top: 2.5rem; border-bottom: 1px solid #8886; }
nav ul { columns: 2; } figure { margin: 1.5rem 0; }
figure img { max-width: 100%; height: auto; background: white; }
figcaption, .note { font-size: .9rem; opacity: .85; }
.table { overflow-x: auto; } table { border-collapse: collapse; font-size: .85rem; }
th, td { padding: .25rem .6rem; border-bottom: 1px solid #8884; text-align: right; }
th { vertical-align: bottom; } th:first-child, td:first-child, td.text { text-align: left; }
summary { cursor: pointer; font-weight: 600; }
@media (max-width: 40rem) { nav ul { columns: 1; } body { margin: 1rem auto; } }
dt { font-weight: 600; } dd { margin: 0 0 .5rem 1.5rem; }
p, dd, h1, figcaption { overflow-wrap: anywhere; }
pre { overflow-x: auto; padding: .6rem; border: 1px solid #8884; }
";

/// An HTML page that needs no other file.
#[derive(Debug, Clone, Default)]
pub(crate) struct Page {
    /// Title of the page and of the browser window.
    pub title: String,
    /// Introduction of a sentence or two.
    pub lead: String,
    /// Sections, in order.
    pub sections: Vec<Section>,
}

#[derive(Debug, Clone, Default)]
pub(crate) struct Section {
    /// Heading, also used in the table of contents.
    pub title: String,
    /// Contents, from top to bottom.
    pub blocks: Vec<Block>,
}

#[derive(Debug, Clone)]
pub(crate) enum Block {
    /// A paragraph.
    Text(String),
    /// Preformatted lines, such as commands.
    Code(String),
    /// A picture with its caption.
    Picture {
        /// Content of a PNG or GIF file.
        bytes: Vec<u8>,
        /// Caption below the picture, also its alternative text.
        caption: String,
    },
    /// A picture in a file beside the page.
    File {
        /// Name of the file.
        name: String,
        /// Caption below the picture, also its alternative text.
        caption: String,
    },
    /// A movie in a file beside the page, read once the reader opens it.
    Movie {
        /// Name of the file.
        name: String,
        /// Size of the file, bytes.
        bytes: usize,
        /// Caption, also its alternative text.
        caption: String,
    },
    /// Terms with their descriptions.
    List(Vec<(String, String)>),
    Table {
        /// Column headings.
        head: Vec<String>,
        /// Cells of each row.
        rows: Vec<Vec<String>>,
        /// Conditions, shown below the table.
        note: String,
    },
}

impl Page {
    /// Writes the page.
    ///
    /// # Errors
    ///
    /// A writer that fails, and a picture that cannot be encoded.
    pub(crate) fn write(&self, out: &mut dyn Write) -> Result<(), ReportError> {
        let page = self.markup().into_string();
        out.write_all(eit_skin::text::printable(&page).as_bytes()).map_err(io)
    }

    fn markup(&self) -> Markup {
        html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    title { (self.title) }
                    style { (PreEscaped(STYLE)) }
                }
                body {
                    h1 { (self.title) }
                    p { (self.lead) }
                    @for (number, section) in self.sections.iter().enumerate() {
                        section id=(format!("s{number}")) {
                            h2 { (section.title) }
                            @for block in &section.blocks { (block.markup()) }
                        }
                        // the result first, then the list of what else there is
                        @if number == 0 && self.sections.len() > 2 {
                            nav { ul {
                                @for (number, section) in self.sections.iter().enumerate().skip(1) {
                                    li { a href=(format!("#s{number}")) { (section.title) } }
                                }
                            } }
                        }
                    }
                }
            }
        }
    }
}

impl Block {
    fn markup(&self) -> Markup {
        match self {
            Self::Text(text) => html! { p { (text) } },
            Self::Code(text) => html! { pre { (text) } },
            Self::Picture { bytes, caption } => {
                let kind = if bytes.starts_with(b"GIF8") { "gif" } else { "png" };
                let data = format!("data:image/{kind};base64,{}", STANDARD.encode(bytes));
                html! { figure { img src=(data) alt=(caption); figcaption { (caption) } } }
            }
            Self::File { name, caption } => html! {
                figure { img src=(name) alt=(caption) loading="lazy"; figcaption { (caption) } }
            },
            Self::Movie { name, bytes, caption } => html! {
                details {
                    summary { (caption) " (movie, " (format!("{:.1}", 1e-6 * *bytes as f64)) " MB)" }
                    figure { img src=(name) alt=(caption) loading="lazy"; }
                }
            },
            Self::List(pairs) => html! {
                dl { @for (name, words) in pairs { dt { (name) } dd { (words) } } }
            },
            Self::Table { head, rows, note } => html! {
                div class="table" { table {
                    thead { tr { @for name in head { th { (name) } } } }
                    tbody { @for row in rows { tr { @for cell in row {
                        td class=[(!is_number(cell)).then_some("text")] { (cell) }
                    } } } }
                } }
                p class="note" { (note) }
            },
        }
    }
}

/// Whether a cell is a number, which is right-aligned.
fn is_number(cell: &str) -> bool {
    cell.starts_with(|c: char| c.is_ascii_digit() || matches!(c, '-' | '+'))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names of recordings and scenes appear as plain text, whatever they contain, and the page
    /// loads nothing.
    #[test]
    fn the_page_is_closed_and_text_stays_text() {
        let page = Page {
            title: "a <b> & \"c\"".to_owned(),
            lead: "</style><script>".to_owned(),
            sections: vec![Section {
                title: "one".to_owned(),
                blocks: vec![
                    Block::Text("x < y".to_owned()),
                    Block::Code("eit plan 'a'".to_owned()),
                    Block::Picture { bytes: b"GIF89a".to_vec(), caption: "\"><img".to_owned() },
                    Block::Picture { bytes: vec![0x89, b'P'], caption: String::new() },
                    Block::File { name: "a\"b.png".to_owned(), caption: String::new() },
                    Block::Movie {
                        name: "m.gif".to_owned(),
                        bytes: 2_000_000,
                        caption: "<i>".to_owned(),
                    },
                    Block::List(vec![("n".to_owned(), "w".to_owned())]),
                    Block::Table {
                        head: vec!["h".to_owned()],
                        rows: vec![vec!["1.5".to_owned()], vec!["<td>".to_owned()]],
                        note: String::new(),
                    },
                ],
            }],
        };
        let mut bytes = Vec::new();
        page.write(&mut bytes).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        assert!(text.starts_with("<!DOCTYPE html>"), "{text}");
        assert!(text.contains("data:image/gif;base64,R0lGODlh"), "{text}");
        assert!(text.contains("data:image/png;base64,iVA="), "{text}");
        assert!(text.contains("<td>1.5</td>") && text.contains("<td class=\"text\">&lt;td&gt;"));
        assert!(
            text.contains("src=\"a&quot;b.png\"") && text.contains("(movie, 2.0 MB)"),
            "{text}"
        );
        // a movie is not read before it is opened
        assert!(
            text.contains("<details><summary>&lt;i&gt;")
                && text.contains("src=\"m.gif\" alt=\"&lt;i&gt;\" loading=\"lazy\"")
        );
        for never in ["<script", "http:", "https:", "<b>", "\"><img", "url("] {
            assert!(!text.contains(never), "{never} in {text}");
        }
    }
}
