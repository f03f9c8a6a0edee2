//! Every test of the tree can fail: it asserts, unwraps or panics, itself or by a function that it calls.

use proc_macro2::{TokenStream, TokenTree};
use quote::ToTokens;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use syn::visit::{self, Visit};

/// Names that can end a test.
const ENDS: [&str; 9] =
    ["assert", "assert_eq", "assert_ne", "panic", "unwrap", "unwrap_err", "expect", "expect_err", "unreachable"];

#[derive(Default)]
struct Functions {
    /// By name, the names in the bodies of all functions that have it.
    names: BTreeMap<String, BTreeSet<String>>,
    /// Tests with their file.
    tests: Vec<(String, PathBuf)>,
    file: PathBuf,
}

fn names_in(tokens: TokenStream, out: &mut BTreeSet<String>) {
    for token in tokens {
        match token {
            TokenTree::Ident(name) => {
                out.insert(name.to_string());
            }
            TokenTree::Group(group) => names_in(group.stream(), out),
            // A test that returns its errors fails by `?`.
            TokenTree::Punct(sign) if sign.as_char() == '?' => {
                out.insert("?".into());
            }
            _ => {}
        }
    }
}

impl Functions {
    fn add(&mut self, sig: &syn::Signature, block: &syn::Block, attrs: &[syn::Attribute]) {
        let name = sig.ident.to_string();
        let mut names = BTreeSet::new();
        names_in(block.to_token_stream(), &mut names);
        let returns = matches!(sig.output, syn::ReturnType::Type(..));
        if !returns {
            names.remove("?");
        }
        let is_test = attrs.iter().any(|a| a.path().is_ident("test"));
        if is_test {
            self.tests.push((name.clone(), self.file.clone()));
        }
        // A test that shall panic fails by itself.
        if attrs.iter().any(|a| a.path().is_ident("should_panic")) {
            names.insert("panic".into());
        }
        let key = if is_test { format!("{} {name}", self.file.display()) } else { name };
        self.names.entry(key).or_default().extend(names);
    }

    /// Names of functions that can end a test.
    fn ends(&self) -> BTreeSet<&str> {
        let mut ends: BTreeSet<&str> = ENDS.into_iter().chain(["?"]).collect();
        loop {
            let more: Vec<&str> = self
                .names
                .iter()
                .filter(|(name, inside)| {
                    !ends.contains(name.as_str()) && inside.iter().any(|n| ends.contains(n.as_str()))
                })
                .map(|(name, _)| name.as_str())
                .collect();
            if more.is_empty() {
                return ends;
            }
            ends.extend(more);
        }
    }

    fn idle(&self) -> Vec<String> {
        let ends = self.ends();
        let keys = self.tests.iter().map(|(name, file)| format!("{} {name}", file.display()));
        keys.filter(|key| !ends.contains(key.as_str())).collect()
    }
}

impl<'ast> Visit<'ast> for Functions {
    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.add(&item.sig, &item.block, &item.attrs);
        visit::visit_item_fn(self, item);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.add(&item.sig, &item.block, &item.attrs);
        visit::visit_impl_item_fn(self, item);
    }
}

fn files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && !["target", "node_modules", ".git"].contains(&name.as_str()) {
            files(&path, out);
        } else if name.ends_with(".rs") {
            out.push(path);
        }
    }
}

/// Functions of sources that are tests or called by tests: of files with tests, and of test folders.
fn functions(sources: impl Iterator<Item = (PathBuf, String)>) -> Functions {
    let mut functions = Functions::default();
    for (path, text) in sources {
        let is_test = path.components().any(|c| c.as_os_str() == "tests") || path.ends_with("tests.rs");
        functions.file = path;
        let file = syn::parse_file(&text).unwrap();
        if is_test {
            functions.visit_file(&file);
        } else {
            for item in &file.items {
                if let syn::Item::Mod(module) = item
                    && module.attrs.iter().any(|a| a.path().is_ident("cfg"))
                {
                    functions.visit_item_mod(module);
                }
            }
        }
    }
    functions
}

#[test]
fn every_test_can_fail() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut paths = Vec::new();
    files(&root, &mut paths);
    let checks = root.join("conformance/src");
    let sources = paths.into_iter().map(|path| (path.clone(), std::fs::read_to_string(&path).unwrap()));
    let mut functions = functions(sources);
    // The checks that tests of several crates call.
    let mut shared = Vec::new();
    files(&checks, &mut shared);
    for path in shared {
        functions.visit_file(&syn::parse_file(&std::fs::read_to_string(path).unwrap()).unwrap());
    }
    assert!(functions.tests.len() > 900, "{}", functions.tests.len());
    assert_eq!(functions.idle(), Vec::<String>::new(), "tests that nothing can make fail");
}

#[test]
fn idle_tests_are_found() {
    let text = "fn helper(x: u8) { assert!(x > 1); }
        fn silent(x: u8) { println!(\"{x}\"); }
        #[test] fn asserts() { assert_eq!(1, 1); }
        #[test] fn calls() { for x in 0..3 { helper(x); } }
        #[test] fn returns() -> Result<(), String> { Err(String::new())?; Ok(()) }
        #[test] fn idle() { silent(1); let _ = 1 + 1; }
        #[test] fn question_in_a_closure() { let _ = || { None?; Some(1) }; }";
    let found = functions([(PathBuf::from("tests/a.rs"), text.to_owned())].into_iter()).idle();
    assert_eq!(found, ["tests/a.rs idle", "tests/a.rs question_in_a_closure"]);
}
