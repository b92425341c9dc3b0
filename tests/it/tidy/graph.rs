//! The files of src/ as a graph of imports: circles within a room, and folders that are entered past their mod.rs.

use super::blank::{blank, without_tests};
use super::paths::{Import, inline_paths, line, uses, words};
use std::collections::{BTreeMap, BTreeSet};

/// A module path such as `dic::subset::warp`, name by name.
type Module = Vec<String>;

/// One file of production code.
struct File {
    path: String,
    code: String,
    imports: Vec<Import>,
    /// The code without `use` declarations.
    rest: String,
    /// The names that the file defines.
    defined: BTreeSet<String>,
}

/// The production files of src/ and what each imports.
pub struct Graph {
    files: BTreeMap<Module, File>,
    /// From a module to the modules that it imports, each with the line of the first import.
    edges: BTreeMap<Module, BTreeMap<Module, usize>>,
    /// Modules that are named past their mod.rs: file, line and rule.
    pub past_the_door: Vec<(String, usize, String)>,
}

impl Graph {
    /// Reads the files under src/ of `sources` (path from the root, text); test modules are left out.
    pub fn new(sources: &[(String, String)]) -> Self {
        let mut files = BTreeMap::new();
        let mut tests = BTreeSet::new();
        for (path, text) in sources {
            let Some(module) = module_of(path) else { continue };
            let whole = blank(text);
            let code = without_tests(&whole);
            let production = declared(&code);
            tests.extend(declared(&whole).difference(&production).map(|name| child(&module, name)));
            let (imports, rest) = uses(&code);
            let defined = defined(&code);
            files.insert(module, File { path: path.clone(), code, imports, rest, defined });
        }
        let is_test = |module: &Module| (1..=module.len()).any(|length| tests.contains(&module[..length]));
        files.retain(|module, _| !is_test(module));
        let mut graph = Self { files, edges: BTreeMap::new(), past_the_door: Vec::new() };
        for module in graph.files.keys().cloned().collect::<Vec<_>>() {
            graph.add_imports(&module);
        }
        graph
    }

    /// The paths of the production files.
    pub fn paths(&self) -> impl Iterator<Item = &str> {
        self.files.values().map(|file| file.path.as_str())
    }

    fn add_imports(&mut self, module: &Module) {
        let file = &self.files[module];
        let mut paths: Vec<(usize, Module, bool)> = file
            .imports
            .iter()
            .map(|import| (import.at, names(&import.path), import.is_public))
            .chain(inline_paths(&file.rest).into_iter().map(|(at, path)| (at, path, false)))
            .collect();
        let (mut edges, mut past) = (BTreeMap::new(), Vec::new());
        for (at, path, is_public) in &mut paths {
            let Some((base, path)) = self.start(module, path) else { continue };
            let (defining, named) = self.resolve(&base, &path, 0);
            let at = line(&file.code, *at);
            past.extend(
                named
                    .iter()
                    .filter(|named| self.is_past_the_door(module, named))
                    .map(|named| (file.path.clone(), at, format!("{} is named past its mod.rs", named.join("::")))),
            );
            let is_reexport = *is_public && named.first().is_some_and(|first| first.starts_with(module));
            let Some(target) = defining else { continue };
            let is_same_room = target.first() == module.first();
            // A file below a module is a part of it: what it takes from there is no import.
            if !is_reexport && is_same_room && !module.starts_with(&target) {
                edges.entry(target).or_insert(at);
            }
        }
        self.past_the_door.extend(past);
        self.edges.insert(module.clone(), edges);
    }

    /// The module at which a path begins and the rest of the path, or `None` for another crate.
    fn start(&self, module: &Module, path: &[String]) -> Option<(Module, Module)> {
        let mut base = module.clone();
        let mut rest = path;
        match path.first()?.as_str() {
            "crate" | "ricochet" => (base, rest) = (Module::new(), &path[1..]),
            "self" => rest = &path[1..],
            "super" => {
                while rest.first().is_some_and(|name| name == "super") {
                    base.pop();
                    rest = &rest[1..];
                }
            }
            first if self.files.contains_key(&child(module, first)) => {}
            first => {
                // A module under its own name, imported before.
                let import = self.files[module].import_of(first)?;
                let (base, mut whole) = self.start_of_import(module, &import.path)?;
                whole.extend_from_slice(&path[1..]);
                return Some((base, whole));
            }
        }
        Some((base, rest.to_vec()))
    }

    fn start_of_import(&self, module: &Module, path: &str) -> Option<(Module, Module)> {
        let path = names(path);
        let first = path.first()?;
        let is_rooted = ["crate", "ricochet", "self", "super"].contains(&first.as_str());
        (is_rooted || self.files.contains_key(&child(module, first))).then(|| self.start(module, &path))?
    }

    /// The module that defines what a path from `base` names, and the modules named on the way.
    fn resolve(&self, base: &Module, path: &[String], depth: usize) -> (Option<Module>, Vec<Module>) {
        let mut module = base.clone();
        let mut named = Vec::new();
        for (index, name) in path.iter().enumerate() {
            let inner = child(&module, name);
            let is_last = index + 1 == path.len();
            let file = self.files.get(&module);
            let reexport = file.and_then(|file| file.import_of(name));
            let is_item = is_last && (reexport.is_some() || file.is_some_and(|file| file.defined.contains(name)));
            if self.files.contains_key(&inner) && !is_item {
                named.push(inner.clone());
                module = inner;
                continue;
            }
            let Some(file) = file else { return (None, named) };
            if file.defined.contains(name) || depth > 8 {
                return (Some(module), named);
            }
            let follow = |import: &Import| {
                let (base, mut whole) = self.start_of_import(&module, &import.path)?;
                whole.extend_from_slice(&path[index + usize::from(!import.is_glob)..]);
                self.resolve(&base, &whole, depth + 1).0
            };
            if let Some(import) = reexport {
                return (follow(import), named);
            }
            let mut through_glob = file.imports.iter().filter(|import| import.is_glob).filter_map(follow);
            let defining = through_glob.find(|found| self.files[found].defined.contains(name));
            return (Some(defining.unwrap_or(module)), named);
        }
        (self.files.contains_key(&module).then_some(module), named)
    }

    /// Whether `named` lies in a folder with a mod.rs that opens it to some, and `module` outside of that folder.
    fn is_past_the_door(&self, module: &Module, named: &Module) -> bool {
        let (name, folder) = named.split_last().unwrap();
        let Some(door) = self.files.get(folder).filter(|file| file.path.ends_with("/mod.rs")) else { return false };
        let is_open = words(&door.code, "mod").any(|at| {
            let declares = door.code[at + 3..].trim_start().strip_prefix(name.as_str());
            declares.is_some_and(|rest| rest.starts_with(';')) && door.code[..at].trim_end().ends_with("pub")
        });
        !module.starts_with(folder) && !is_open
    }

    /// The circles of imports, each as the sorted paths of its files.
    pub fn circles(&self) -> Vec<Vec<&str>> {
        let reached: BTreeMap<&Module, BTreeSet<&Module>> =
            self.files.keys().map(|module| (module, self.reached_from(module))).collect();
        let mut circles: Vec<Vec<&str>> = Vec::new();
        for (module, reach) in &reached {
            let circle: Vec<&Module> = reach.iter().copied().filter(|other| reached[other].contains(module)).collect();
            if circle.first() == Some(module) && circle.len() > 1 {
                circles.push(circle.iter().map(|module| self.files[*module].path.as_str()).collect());
            }
        }
        circles
    }

    fn reached_from<'g>(&'g self, module: &'g Module) -> BTreeSet<&'g Module> {
        let mut reached = BTreeSet::new();
        let mut open = vec![module];
        while let Some(module) = open.pop() {
            open.extend(self.edges[module].keys().filter(|other| reached.insert(*other)));
        }
        reached
    }

    /// The imports within a circle, one a line.
    pub fn explain(&self, circle: &[&str]) -> String {
        let mut lines = Vec::new();
        for (module, targets) in &self.edges {
            for (target, line) in targets {
                let (from, to) = (&self.files[module].path, &self.files[target].path);
                if circle.contains(&from.as_str()) && circle.contains(&to.as_str()) {
                    lines.push(format!("    {from}:{line} imports {to}"));
                }
            }
        }
        lines.join("\n")
    }
}

impl File {
    /// The import that brings `name` into the file.
    fn import_of(&self, name: &str) -> Option<&Import> {
        self.imports.iter().find(|import| {
            let path = import.path.strip_suffix("::self").unwrap_or(&import.path);
            let last = path.rsplit("::").next().unwrap_or_default();
            !import.is_glob && import.alias.as_deref().unwrap_or(last) == name
        })
    }
}

/// The module of a file under src/, other than lib.rs and main.rs.
fn module_of(path: &str) -> Option<Module> {
    let inside = path.strip_prefix("src/")?.strip_suffix(".rs")?;
    let inside = inside.strip_suffix("/mod").unwrap_or(inside);
    (!["lib", "main"].contains(&inside)).then(|| inside.split('/').map(str::to_string).collect())
}

fn child(module: &Module, name: &str) -> Module {
    module.iter().map(String::as_str).chain([name]).map(str::to_string).collect()
}

fn names(path: &str) -> Module {
    path.strip_suffix("::self").unwrap_or(path).split("::").map(str::to_string).collect()
}

/// The modules that a file declares and keeps in files of their own.
fn declared(code: &str) -> BTreeSet<String> {
    let name = |at: usize| Some(code[at + 3..].split_once(';')?.0.trim().to_string());
    let is_name = |name: &String| name.chars().all(|c| c.is_alphanumeric() || c == '_');
    words(code, "mod").filter_map(name).filter(is_name).collect()
}

/// The names of the items that a file defines, those of its inline modules included.
fn defined(code: &str) -> BTreeSet<String> {
    let keywords = ["fn", "struct", "enum", "trait", "type", "const", "static", "union", "mod", "macro_rules"];
    let mut defined = BTreeSet::new();
    for keyword in keywords {
        for at in words(code, keyword) {
            let rest = code[at + keyword.len()..].trim_start_matches(|c: char| c == '!' || c.is_whitespace());
            let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
            if !(keyword == "mod" && rest[end..].starts_with(';')) {
                defined.insert(rest[..end].to_string());
            }
        }
    }
    defined
}
