mod columns; mod weights; mod decay; mod fading; mod report; mod ripple; mod signal; mod support; mod woven;
use std::path::Path;
fn main() { let f = Path::new("out/paper"); std::fs::create_dir_all(f).unwrap(); let mut r = report::Report::default();
 support::draw(&mut r, f).unwrap(); woven::draw(&mut r, f, 50).unwrap(); ripple::draw(&mut r, f).unwrap(); fading::draw(&mut r, f).unwrap(); columns::draw(&mut r, f).unwrap(); r.finish(f, "x").unwrap(); }
