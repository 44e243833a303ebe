//! Templates of leg settings: chains of elements, each of which is read once.

use super::context::Context;
use super::xml::Element;
use std::collections::HashMap;
use std::path::PathBuf;

/// Reads settings elements with their templates as defaults.
pub(super) struct Templates<L> {
    tag: &'static str,
    /// Reads an element with the given settings as defaults.
    read: fn(&Context, &Element, &L) -> L,
    known: HashMap<(PathBuf, usize), L>,
}

impl<L: Clone> Templates<L> {
    pub fn new(tag: &'static str, read: fn(&Context, &Element, &L) -> L) -> Templates<L> {
        Templates { tag, read, known: HashMap::new() }
    }

    /// The settings of the element's template, applied on top of the template's own template and so on, down
    /// to `default`; `None` without a `template` attribute or when it cannot be resolved.
    pub fn of(&mut self, context: &Context, element: &Element, default: &L) -> Option<L> {
        let mut chain = Vec::new();
        let mut seen = vec![element.key()];
        let mut layer = None;
        let mut at = element.clone();
        while let Some(reference) = at.value("template") {
            let template = context.asset(self.tag, &at, "template")?;
            if let Some(known) = self.known.get(&template.key()) {
                layer = Some(known.clone());
                break;
            }
            if seen.contains(&template.key()) {
                let message = format!("the template `{reference}` refers to itself");
                context.error(at.value_place("template"), message);
                return None;
            }
            seen.push(template.key());
            chain.push(template.clone());
            at = template;
        }
        for template in chain.iter().rev() {
            let read = (self.read)(context, template, layer.as_ref().unwrap_or(default));
            self.known.insert(template.key(), read.clone());
            layer = Some(read);
        }
        layer
    }
}
