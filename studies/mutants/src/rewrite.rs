//! Mutants of a file, written into it side by side: each is an arm of a branch that a switch takes.

use proc_macro2::Span;
use std::collections::BTreeMap;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{BinOp, Expr, ReturnType, Signature, Type, UnOp};

/// A fault that one line may have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mutant {
    /// File, from the workspace's folder.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Function that it is in, with its type.
    pub function: String,
    /// What is replaced by what.
    pub change: String,
    /// The line's text.
    pub text: String,
    /// Which of those it is that are equal in all that, from 1.
    pub nth: usize,
}

impl Mutant {
    /// What names it where lines move: file, function, the line's text and the change.
    pub fn key(&self) -> String {
        let nth = if self.nth == 1 { String::new() } else { format!(" ({})", self.nth) };
        format!("{} | {} | {}{nth} | {}", self.file, self.function, self.change, self.text)
    }
}

/// The text of a file with those of its mutants that `is_wanted` says. They are numbered from `mutants.len()`
/// on and added to it.
pub fn rewrite(file: &str, text: &str, is_wanted: &dyn Fn(&Mutant) -> bool, mutants: &mut Vec<Mutant>) -> String {
    let Ok(syntax) = syn::parse_file(text) else { return text.to_owned() };
    let lines: Vec<&str> = text.lines().collect();
    let mut rewriter = Rewriter {
        file,
        lines,
        text,
        is_wanted,
        mutants,
        edits: Vec::new(),
        scope: Vec::new(),
        count: BTreeMap::new(),
    };
    rewriter.visit_file(&syntax);
    let mut edits = rewriter.edits;
    // At one place what ends stands before what begins, and what begins last is the innermost.
    edits.sort_by_key(|e| (e.at, e.order));
    let (mut out, mut from) = (String::with_capacity(2 * text.len()), 0);
    for edit in &edits {
        out.push_str(&text[from..edit.at]);
        out.push_str(&edit.text);
        from = edit.at + edit.skips;
    }
    out.push_str(&text[from..]);
    out
}

/// Text that is put at a byte, in place of `skips` bytes.
struct Edit {
    at: usize,
    skips: usize,
    /// Ends come before beginnings; of ends the inner first, of beginnings the outer first.
    order: (u8, i64),
    text: String,
}

struct Rewriter<'a> {
    file: &'a str,
    lines: Vec<&'a str>,
    text: &'a str,
    is_wanted: &'a dyn Fn(&Mutant) -> bool,
    mutants: &'a mut Vec<Mutant>,
    edits: Vec<Edit>,
    scope: Vec<String>,
    /// Mutants by key.
    count: BTreeMap<String, usize>,
}

/// Operators in place of one.
fn others(op: &BinOp) -> &'static [&'static str] {
    match op {
        BinOp::Add(_) => &["-", "*"],
        BinOp::Sub(_) => &["+", "/"],
        BinOp::Mul(_) => &["/", "+"],
        BinOp::Div(_) => &["*", "%"],
        BinOp::Rem(_) => &["/", "+"],
        BinOp::BitAnd(_) => &["|", "^"],
        BinOp::BitOr(_) | BinOp::BitXor(_) => &["&"],
        BinOp::Shl(_) => &[">>"],
        BinOp::Shr(_) => &["<<"],
        BinOp::Eq(_) => &["!="],
        BinOp::Ne(_) => &["=="],
        BinOp::Lt(_) => &["==", ">", "<="],
        BinOp::Gt(_) => &["==", "<", ">="],
        BinOp::Le(_) => &[">"],
        BinOp::Ge(_) => &["<"],
        BinOp::AddAssign(_) => &["-=", "*="],
        BinOp::SubAssign(_) => &["+=", "/="],
        BinOp::MulAssign(_) => &["/=", "+="],
        BinOp::DivAssign(_) => &["*=", "%="],
        BinOp::BitAndAssign(_) => &["|="],
        BinOp::BitOrAssign(_) | BinOp::BitXorAssign(_) => &["&="],
        _ => &[],
    }
}

/// Whether a condition binds names, which a branch would lose.
fn binds(expr: &Expr) -> bool {
    match expr {
        Expr::Let(_) => true,
        Expr::Binary(b) => matches!(b.op, BinOp::And(_)) && (binds(&b.left) || binds(&b.right)),
        _ => false,
    }
}

/// What a function may return in place of its value.
fn constants(output: &ReturnType) -> Vec<&'static str> {
    let ReturnType::Type(_, ty) = output else { return vec![""] };
    let name = quote_of(ty);
    match name.as_str() {
        "f64" | "f32" => vec!["0.0", "1.0"],
        "bool" => vec!["true", "false"],
        "usize" | "u64" | "u32" | "u16" | "u8" | "i64" | "i32" => vec!["0", "1"],
        "[f64;2]" | "[f32;2]" => vec!["[0.0; 2]", "[1.0; 2]"],
        "[f64;3]" | "[f32;3]" => vec!["[0.0; 3]", "[1.0; 3]"],
        "String" => vec!["String::new()"],
        n if n.starts_with("Option<") => vec!["None"],
        n if n.starts_with("Vec<") => vec!["Vec::new()"],
        n if n.starts_with("Result<()") => vec!["Ok(())"],
        _ => Vec::new(),
    }
}

/// A type's text without spaces.
fn quote_of(ty: &Type) -> String {
    quote::ToTokens::to_token_stream(ty).to_string().replace(' ', "")
}

impl Rewriter<'_> {
    fn put(&mut self, at: usize, skips: usize, order: (u8, i64), text: String) {
        self.edits.push(Edit { at, skips, order, text });
    }

    /// The number of a mutant; none if it is left out.
    fn number(&mut self, place: Span, change: String) -> Option<usize> {
        let line = place.start().line;
        let text = self.lines.get(line - 1).map_or("", |l| l.trim()).to_owned();
        let function = self.scope.join("::");
        let mut mutant = Mutant { file: self.file.to_owned(), line, function, change, text, nth: 1 };
        let nth = self.count.entry(mutant.key()).or_default();
        *nth += 1;
        mutant.nth = *nth;
        if !(self.is_wanted)(&mutant) {
            return None;
        }
        self.mutants.push(mutant);
        Some(self.mutants.len() - 1)
    }

    /// Wraps an expression: `head` before it and `tail` after it.
    fn wrap(&mut self, whole: Span, head: String, tail: String) {
        let range = whole.byte_range();
        let length = i64::try_from(range.len()).expect("files are short");
        self.put(range.start, 0, (1, -length), head);
        self.put(range.end, 0, (0, length), tail);
    }

    /// The branches of mutants, with `make` the expression of each operator, and the one as it is.
    fn branches(&mut self, place: Span, of: &str, others: &[&str], make: &dyn Fn(&str) -> String) -> Option<String> {
        let mut text = String::new();
        for other in others {
            let Some(id) = self.number(place, format!("{of} to {}", if other.is_empty() { "nothing" } else { other }))
            else {
                continue;
            };
            text += &format!("if crate::mutant_switch::on({id}) {{ {} }} else ", make(other));
        }
        (!text.is_empty()).then(|| format!("{text}{{ {} }}", make(of)))
    }

    fn function(&mut self, attributes: &[syn::Attribute], sig: &Signature, block: &syn::Block) {
        // Constants are evaluated by the compiler, which no switch reaches.
        if is_test(attributes) || sig.constness.is_some() {
            return;
        }
        self.scope.push(sig.ident.to_string());
        self.replace_body(sig, block);
        self.visit_block(block);
        self.scope.pop();
    }

    /// Mutants that return a constant at once.
    fn replace_body(&mut self, sig: &Signature, block: &syn::Block) {
        if block.stmts.is_empty() || sig.ident == "fmt" || sig.ident == "drop" {
            return;
        }
        let at = block.brace_token.span.open().byte_range().end;
        let mut text = String::new();
        for value in constants(&sig.output) {
            let whole = self.text[block.brace_token.span.join().byte_range()].trim_matches(['{', '}', ' ', '\n']);
            if whole == value {
                continue;
            }
            let change = format!("whole body to {}", if value.is_empty() { "nothing" } else { value });
            if let Some(id) = self.number(sig.ident.span(), change) {
                text += &format!(" if crate::mutant_switch::on({id}) {{ return {value}; }}");
            }
        }
        if !text.is_empty() {
            self.put(at, 0, (0, i64::MAX), text);
        }
    }
}

fn is_test(attrs: &[syn::Attribute]) -> bool {
    attrs.iter().any(|a| {
        let text = quote::ToTokens::to_token_stream(&a.meta).to_string().replace(' ', "");
        text == "test" || text.starts_with("cfg(test") || text.starts_with("cfg(all(test")
    })
}

impl<'ast> Visit<'ast> for Rewriter<'_> {
    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if !is_test(&item.attrs) {
            visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_const(&mut self, _: &'ast syn::ItemConst) {}
    fn visit_item_static(&mut self, _: &'ast syn::ItemStatic) {}
    fn visit_impl_item_const(&mut self, _: &'ast syn::ImplItemConst) {}
    fn visit_trait_item_const(&mut self, _: &'ast syn::TraitItemConst) {}
    fn visit_type(&mut self, _: &'ast Type) {}
    fn visit_pat(&mut self, _: &'ast syn::Pat) {}
    fn visit_generic_argument(&mut self, _: &'ast syn::GenericArgument) {}
    fn visit_attribute(&mut self, _: &'ast syn::Attribute) {}
    fn visit_expr_const(&mut self, _: &'ast syn::ExprConst) {}

    fn visit_expr_repeat(&mut self, expr: &'ast syn::ExprRepeat) {
        self.visit_expr(&expr.expr);
    }

    fn visit_item_impl(&mut self, item: &'ast syn::ItemImpl) {
        if is_test(&item.attrs) {
            return;
        }
        self.scope.push(quote_of(&item.self_ty));
        visit::visit_item_impl(self, item);
        self.scope.pop();
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.function(&item.attrs, &item.sig, &item.block);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.function(&item.attrs, &item.sig, &item.block);
    }

    fn visit_expr_unary(&mut self, expr: &'ast syn::ExprUnary) {
        let of = match expr.op {
            UnOp::Neg(_) => "-",
            UnOp::Not(_) => "!",
            _ => {
                self.visit_expr(&expr.expr);
                return;
            }
        };
        if let Some(branches) = self.branches(expr.op.span(), of, &[""], &|op| format!("{op} x")) {
            self.wrap(expr.span(), "(match ".into(), format!(" {{ x => {branches} }})"));
            let op = expr.op.span().byte_range();
            self.put(op.start, op.len(), (2, 0), String::new());
        }
        self.visit_expr(&expr.expr);
    }

    fn visit_expr_binary(&mut self, expr: &'ast syn::ExprBinary) {
        let (op, place) = (expr.op.span().byte_range(), expr.op.span());
        let sign = self.text[op.clone()].to_owned();
        match expr.op {
            BinOp::And(_) | BinOp::Or(_) => {
                let whole = Expr::Binary(expr.clone());
                let is_and = matches!(expr.op, BinOp::And(_));
                let other = if is_and { "||" } else { "&&" };
                if !binds(&whole)
                    && let Some(id) = self.number(place, format!("{sign} to {other}"))
                {
                    // `l && r` is `if l { r } else { false }`, and `l || r` the same of `!l` and `true`.
                    let on = format!("{}crate::mutant_switch::on({id})", if is_and { "" } else { "!" });
                    self.wrap(expr.span(), "(if (".into(), format!(" }} else {{ {on} }})"));
                    self.put(op.start, op.len(), (2, 0), format!(") ^ {on} {{ "));
                }
            }
            BinOp::Eq(_) | BinOp::Ne(_) | BinOp::Lt(_) | BinOp::Gt(_) | BinOp::Le(_) | BinOp::Ge(_) => {
                if let Some(branches) = self.branches(place, &sign, others(&expr.op), &|op| format!("l {op} r")) {
                    self.wrap(expr.span(), "(match (&(".into(), format!(")) {{ (l, r) => {branches} }})"));
                    self.put(op.start, op.len(), (2, 0), "), &(".into());
                }
            }
            _ if sign.ends_with('=') => {
                let left = self.text[expr.left.span().byte_range()].to_owned();
                if let Some(branches) =
                    self.branches(place, &sign, others(&expr.op), &|op| format!("{left} {op} __right"))
                {
                    let range = expr.span().byte_range();
                    self.wrap(expr.span(), "{ let __right = ".into(), format!("; {branches} }}"));
                    // The left side stands in the branches alone.
                    self.put(range.start, op.end - range.start, (2, 0), String::new());
                }
                self.visit_expr(&expr.right);
                return;
            }
            _ => {
                if let Some(branches) = self.branches(place, &sign, others(&expr.op), &|op| format!("l {op} r")) {
                    self.wrap(expr.span(), "(match (".into(), format!(") {{ (l, r) => {branches} }})"));
                    self.put(op.start, op.len(), (2, 0), ", ".into());
                }
            }
        }
        self.visit_expr(&expr.left);
        self.visit_expr(&expr.right);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> (String, Vec<Mutant>) {
        let mut mutants = Vec::new();
        let out = rewrite("a.rs", text, &|_| true, &mut mutants);
        syn::parse_file(&out).unwrap_or_else(|error| panic!("{error}: {out}"));
        (out.replace("crate::mutant_switch::", ""), mutants)
    }

    #[test]
    fn operators_become_branches() {
        let (out, mutants) = of("fn f(a: f64) -> Pair { a * 2.0 }");
        let want = "fn f(a: f64) -> Pair { (match (a , 2.0) { (l, r) => if on(0) { l / r } else if on(1) { l + r } \
                    else { l * r } }) }";
        assert_eq!(out.split_whitespace().collect::<String>(), want.split_whitespace().collect::<String>());
        assert_eq!(mutants[0].key(), "a.rs | f | * to / | fn f(a: f64) -> Pair { a * 2.0 }");
        let (out, _) = of("fn f(a: bool, b: bool) -> Pair { a && b }");
        assert!(out.contains("(if (a ) ^ on(0) {  b } else { on(0) })"), "{out}");
        let (out, _) = of("fn f() -> Pair { r[1] += g(r) }");
        assert!(out.contains("{ let __right =  g(r); if on(0) { r[1] -= __right }"), "{out}");
    }

    #[test]
    fn nested_and_equal_mutants_are_told_apart() {
        let (out, mutants) = of("impl A { fn f(&self) -> f64 { -self.x * self.x + self.y * self.y } }");
        assert_eq!(mutants.len(), 2 + 2 + 2 + 1 + 2, "{out}");
        let keys: std::collections::BTreeSet<_> = mutants.iter().map(Mutant::key).collect();
        assert_eq!(keys.len(), mutants.len());
        assert_eq!(mutants[0].function, "A::f");
    }

    #[test]
    fn tests_constants_and_conditions_that_bind_stay() {
        for text in [
            "const A: f64 = 1.0 + 2.0;",
            "const fn f() -> f64 { 1.0 + 2.0 }",
            "#[cfg(test)] mod tests { fn f() -> f64 { 1.0 + 2.0 } }",
            "fn f() -> Pair { if let Some(x) = y && let Some(z) = x {} }",
            "fn f() -> Pair { [0.0; 2 + 3] }",
        ] {
            assert_eq!(of(text), (text.to_owned(), Vec::new()), "{text}");
        }
    }
}
