//! The blocks of an INPHO project: `$NAME` at a line's beginning up to `$END…` at a line's beginning, with indented
//! `$KEY : value` fields whose values go on over the lines that begin no other field. Lines that begin with `#` are comments.

/// A block of the project, from `$NAME` to `$END`.
pub(super) struct InphoBlock<'a> {
    /// The name without the `$`, such as `PHOTO`.
    pub name: &'a str,
    /// Line of its beginning, counted from 1.
    pub line: u64,
    /// Whether its end was found.
    pub is_closed: bool,
    text: &'a str,
    fields: Vec<InphoField<'a>>,
}

/// A key, and where its value stands in the text.
struct InphoField<'a> {
    key: &'a str,
    start: usize,
    end: usize,
}

impl<'a> InphoBlock<'a> {
    /// The values of a key, in the file's order.
    pub(super) fn all(&self, key: &str) -> impl Iterator<Item = &'a str> {
        self.fields().filter(move |(known, _)| *known == key).map(|(_, value)| value)
    }

    /// The first value of a key, trimmed.
    pub(super) fn text(&self, key: &str) -> Option<&'a str> {
        self.all(key).next().map(str::trim)
    }

    /// A key's numbers, of which there have to be `N`.
    pub(super) fn numbers<const N: usize>(&self, key: &str) -> Result<[f64; N], String> {
        let value = self.text(key).ok_or_else(|| format!("it has no ${key}"))?;
        numbers(value).map_err(|e| format!("${key}: {e}"))
    }

    /// Begins a field with a line that starts at a byte of the text, or goes on with the last.
    fn extend(&mut self, line: &'a str, start: usize) {
        let end = start + line.len();
        if let Some(rest) = line.trim_start().strip_prefix('$') {
            let key = rest.split(':').next().unwrap_or(rest).trim();
            let value = line.find(':').map_or(end, |colon| start + colon + 1);
            self.fields.push(InphoField { key, start: value, end });
        } else if let Some(field) = self.fields.last_mut() {
            field.end = end;
        }
    }

    /// The keys with their values.
    pub(super) fn fields(&self) -> impl Iterator<Item = (&'a str, &'a str)> {
        self.fields.iter().map(|field| (field.key, self.text.get(field.start..field.end).unwrap_or_default()))
    }
}

/// The finite numbers of a text, of which there have to be `N`.
pub(super) fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let words = text.split_ascii_whitespace();
    let found: Option<Vec<f64>> = words.map(|word| word.parse().ok().filter(|n: &f64| n.is_finite())).collect();
    let found = found.ok_or_else(|| format!("{:?}: expected {N} numbers", text.trim()))?;
    let n = found.len();
    found.try_into().map_err(|_| format!("{n} numbers: expected {N}"))
}

/// Cuts a project into its blocks; what stands between them is passed over.
pub(super) fn blocks(text: &str) -> Vec<InphoBlock<'_>> {
    let mut blocks: Vec<InphoBlock<'_>> = Vec::new();
    let mut is_open = false;
    let mut begin = 0;
    for (i, line) in text.split_inclusive('\n').enumerate() {
        let start = begin;
        begin += line.len();
        let word = line.trim();
        if word.starts_with('#') {
            continue;
        }
        let is_outer = line.starts_with('$');
        if is_outer && line.starts_with("$END") {
            if let Some(block) = blocks.last_mut().filter(|_| is_open) {
                block.is_closed = true;
            }
            is_open = false;
        } else if let (true, Some(name)) = (is_outer, word.strip_prefix('$')) {
            let name = name.split([' ', '\t', ':']).next().unwrap_or(name);
            blocks.push(InphoBlock { name, line: i as u64 + 1, is_closed: false, text, fields: Vec::new() });
            is_open = true;
        } else if let Some(block) = blocks.last_mut().filter(|_| is_open) {
            block.extend(line, start);
        }
    }
    blocks
}
