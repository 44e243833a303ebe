//! Compiles what the kernel benchmark needs to call Embree, when the feature `embree` asks for it.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    #[cfg(feature = "embree")]
    embree();
}

#[cfg(feature = "embree")]
fn embree() {
    let shim = "benches/kernel/embree.c";
    println!("cargo::rerun-if-changed={shim}");
    cc::Build::new().file(shim).opt_level(3).flag("-march=native").compile("vlscan_embree");
    println!("cargo::rustc-link-lib=embree3");
}
