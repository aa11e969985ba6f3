//! The `karst` command.
fn main() -> anyhow::Result<()> {
    let t = std::time::Instant::now();
    let e = karst::eval::evaluate(&karst_rig::Rig::default(), 1, || eprint!("."))?;
    println!("{}", serde_json::to_string_pretty(&e)?);
    eprintln!("{:?}", t.elapsed());
    Ok(())
}
