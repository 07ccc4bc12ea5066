//! The HTML reports: whole, without network, and as a browser shows them.

use super::harness::Bench;
use std::path::Path;
use std::process::Command;

/// Debian's Chromium.
const BROWSER: &str = "chromium";

/// What makes it start anywhere, alone and silent.
const ALONE: [&str; 8] = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
];

/// Script that looks at the page as it is laid out, and leaves what it finds as the title: one finding a line.
const PROBE: &str = r#"<script>
const found = [];
for (const more of document.querySelectorAll("details")) more.open = true;
const add = (text) => { if (found.length < 20) found.push(text); };
if (document.documentElement.scrollWidth > innerWidth) add(`page is ${document.documentElement.scrollWidth} wide`);
const figures = [...document.querySelectorAll("figure")];
let texts = 0;
for (const figure of figures) {
  const boxes = [...figure.querySelectorAll("svg text, figcaption > .title, .item")]
    .filter((text) => text.textContent.trim() && text.getBoundingClientRect().width > 0)
    .map((text) => [text.textContent, text.getBoundingClientRect()]);
  texts += boxes.length;
  const svg = [...figure.querySelectorAll("svg")].find((svg) => svg.getBoundingClientRect().width > 0);
  const frame = svg && svg.getBoundingClientRect();
  boxes.forEach(([name, a], index) => {
    for (const [other, b] of boxes.slice(index + 1)) {
      const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (across > 1 && down > 1) add(`"${name}" overlaps "${other}"`);
    }
    if (frame && name !== figure.querySelector(".title").textContent && !figure.querySelector(".legend")?.textContent.includes(name)
        && (a.left < frame.left - 1 || a.right > frame.right + 1 || a.bottom > frame.bottom + 1)) add(`"${name}" is cut off`);
  });
  if (svg && !svg.querySelector("text.axis")) add("an axis without a name");
  const title = figure.querySelector(".title").textContent;
  for (const box of figure.querySelectorAll(".drawing, .scroll"))
    if (box.scrollWidth > box.clientWidth + 1 && (box.matches(".drawing") || getComputedStyle(box).overflowX === "visible"))
      add(`"${title}" is wider than its card`);
  const heights = svg ? [...svg.querySelectorAll("text")].map((text) => text.getBoundingClientRect().height) : [];
  if (Math.min(...heights, 9) < LEAST) add(`"${title}" has text of ${Math.min(...heights)} pixels`);
}
const dark = getComputedStyle(document.body).backgroundColor === "rgb(15, 20, 26)";
document.title = [`figures ${figures.length}`, `texts ${texts}`, `dark ${dark}`, ...found].join("\n");
</script></body>"#;

/// Least height of a line of text in a drawing, pixels: of 7 points on paper.
const LEAST: f64 = 9.0;

/// What a browser shows of a page: what the probe found, and what the console says.
fn look(page: &Path, width: u32, dark: bool) -> (Vec<String>, Vec<String>) {
    let text = std::fs::read_to_string(page).expect("a page");
    assert_eq!(text.matches("</body>").count(), 1);
    let probed = page.with_extension("probed.html");
    std::fs::write(&probed, text.replace("</body>", &PROBE.replace("LEAST", &LEAST.to_string())))
        .expect("a page with a probe");
    let profile = tempfile::tempdir().expect("a directory");
    let mut command = Command::new(BROWSER);
    command.args(ALONE).args(["--enable-logging=stderr", "--dump-dom"]);
    command
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--window-size={width},900"));
    if dark {
        command.arg("--blink-settings=preferredColorScheme=0");
    }
    let output = command.arg(format!("file://{}", probed.display())).output().expect("the browser runs");
    let dom = String::from_utf8_lossy(&output.stdout);
    let title = dom.split("<title>").nth(1).and_then(|rest| rest.split("</title>").next());
    let found = title.unwrap_or_else(|| panic!("no title: {dom}")).lines().map(str::to_owned).collect();
    let log = String::from_utf8_lossy(&output.stderr);
    (found, log.lines().filter(|line| line.contains("CONSOLE")).map(str::to_owned).collect())
}

/// Is there a browser? Says so where there is none.
fn browser() -> bool {
    let there = Command::new(BROWSER).arg("--version").output().is_ok_and(|output| output.status.success());
    if !there {
        eprintln!("skipped: no {BROWSER}; `cargo xtask setup` installs it where it may");
    }
    there
}

/// Frees six parameters: a matrix of correlations that fills a page.
const SIX: [&str; 8] = [
    "--bounds",
    "viscous_friction=0..500",
    "--bounds",
    "load_mass=10..40",
    "--bounds",
    "proportional_gain=9000..11000",
    "--bounds",
    "constant_load=-200..200",
];

fn make_pages(bench: &Bench) -> [&'static str; 6] {
    bench.noisy_record();
    bench.run(&[&["identify", "record.csv", "--out", "identify"], &SIX[..]].concat()).done();
    let long = ["--model", "lf", "--duration", "60", "--command", "sine", "--noise", "lvdt_m=5e-6"];
    bench.simulate(
        "long.csv",
        &[&long[..], &["--frequency", "0.7", "--channels", "lvdt_m", "--dropout", "0.01"]].concat(),
    );
    bench.run(&["identify", "long.csv", "--out", "long", "--budget", "40"]);
    bench.run(&["demo", "--out", "demo"]).done();
    bench.run(&["reproduce", "--lf-data", "--cases-only", "--out", "reproduce"]).done();
    bench.run(&["check", "record.csv", "--out", "check"]).done();
    // Cut off at 2 mm, with lost samples, beside another record.
    let cut: String = bench.read("long.csv").lines().map(|line| cut_off(line) + "\n").collect();
    bench.write("cut.csv", &cut);
    bench.run(&["check", "cut.csv", "record.csv", "--out", "check-two"]).done();
    ["identify", "long", "demo", "reproduce", "check", "check-two"]
}

/// A row of a record whose position, the last cell, stays below 2 mm.
fn cut_off(row: &str) -> String {
    match row.rsplit_once(',') {
        Some((rest, cell)) if cell.parse::<f64>().is_ok_and(|value| value > 2e-3) => format!("{rest},0.002"),
        _ => row.to_owned(),
    }
}

#[test]
fn reports_are_whole_and_a_browser_shows_them_well() {
    let bench = Bench::new();
    let names = make_pages(&bench);
    for name in names {
        let text = bench.read(&format!("{name}/report.html"));
        assert!(text.ends_with("</html>") && text.len() < 1_500_000, "{name}: {} bytes", text.len());
        for outside in ["http:", "https:", "src=", "@import", "<script"] {
            assert!(!text.contains(outside), "{name} has {outside}");
        }
        for part in
            ["Configuration", "seed", env!("CARGO_PKG_VERSION"), "prefers-color-scheme: dark", "@media print"]
        {
            assert!(text.contains(part), "{name} lacks {part}");
        }
    }
    // The case that is shown closely has channels that no fit looked at, and no noise is said of them.
    let text = bench.read("reproduce/report.html");
    assert!(text.contains("No fit looked at this channel.") && !text.contains("noise of −"));
    if !browser() {
        return;
    }
    for (name, width, dark) in names.into_iter().map(|name| (name, 1280, false)).chain([
        ("identify", 500, false),
        ("identify", 1400, false),
        ("check", 500, true),
        ("demo", 500, true),
        ("reproduce", 500, false),
        ("demo", 1280, true),
    ]) {
        let (found, console) = look(&bench.path(&format!("{name}/report.html")), width, dark);
        assert_eq!(console, [""; 0], "{name} at {width}");
        let [figures, texts, scheme, wrong @ ..] = found.as_slice() else { panic!("{found:?}") };
        let count = |text: &str| text.split(' ').nth(1).and_then(|n| n.parse::<usize>().ok()).unwrap_or(0);
        assert!(count(figures) >= 6 && count(texts) >= 60, "{name} at {width}: {found:?}");
        assert_eq!(scheme, &format!("dark {dark}"));
        assert!(wrong.is_empty(), "{name} at {width}: {wrong:#?}");
    }
}

/// A page as paper shows it: 186 mm wide, with the rules for print.
#[test]
fn paper_cuts_nothing_off() {
    if !browser() {
        return;
    }
    let bench = Bench::new();
    bench.noisy_record();
    let six = [&["identify", "record.csv"], &SIX[..]].concat();
    for arguments in [&["check", "record.csv"][..], &["identify", "record.csv"], &six, &["demo"]] {
        bench.run(&[arguments, &["--out", "."]].concat()).done();
        bench.write("paper.html", &bench.read("report.html").replace("@media print", "@media all"));
        let (found, _) = look(&bench.path("paper.html"), 703, false);
        let [figures, _, _, wrong @ ..] = found.as_slice() else { panic!("{found:?}") };
        assert_ne!(figures, "figures 0");
        assert!(wrong.is_empty(), "{arguments:?}: {wrong:#?}");
    }
}

#[test]
fn the_browser_check_sees_what_is_wrong() {
    if !browser() {
        return;
    }
    let bench = Bench::new();
    bench.write(
        "bad.html",
        r#"<!DOCTYPE html><html><head><title></title></head><body><div style="width:3000px">wide</div><figure>
        <figcaption><span class="title">t</span></figcaption><svg viewBox="0 0 100 50" width="400"><text x="10" y="20">one</text>
        <text x="12" y="22">two</text><text x="95" y="40">outside</text></svg></figure>
        <figure><figcaption><span class="title">broad</span></figcaption><div class="drawing" style="width:90px;overflow:auto">
        <svg viewBox="0 0 500 250" width="100"><text class="axis" x="10" y="20">small</text></svg></div></figure>
        <script>console.error("boo")</script></body></html>"#,
    );
    let (found, console) = look(&bench.path("bad.html"), 1280, false);
    let found = found.join("; ");
    for part in [
        "wide",
        "\"one\" overlaps \"two\"",
        "\"outside\" is cut off",
        "axis without a name",
        "\"broad\" is wider than its card",
        "\"broad\" has text of",
    ] {
        assert!(found.contains(part), "{part}: {found}");
    }
    assert!(console.iter().any(|line| line.contains("boo")), "{console:?}");
}
