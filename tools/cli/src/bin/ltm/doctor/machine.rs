//! The machine, as far as it tells.

use std::path::Path;

use ltm::files::free_bytes;
use ltm::resources::{human_bytes, machine_memory};

use super::Finding;

const UNKNOWN: &str = "unknown";

/// The operating system and its C library.
pub(super) fn system() -> Finding {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let release = read("/etc/os-release").and_then(|text| {
        let line = text.lines().find_map(|line| line.strip_prefix("PRETTY_NAME="))?;
        Some(line.trim_matches('"').to_owned())
    });
    let kernel = read("/proc/sys/kernel/osrelease").map(|text| format!("Linux {}", text.trim()));
    let parts: Vec<String> = [release, kernel, c_library()].into_iter().flatten().collect();
    let found =
        if parts.is_empty() { format!("{} (no more is known)", std::env::consts::OS) } else { parts.join(", ") };
    Finding::of("system", found)
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn c_library() -> Option<String> {
    #[expect(unsafe_code, reason = "the C library tells its version through its own interface only")]
    // SAFETY: the call takes nothing and returns a text that lives as long as the program.
    let version = unsafe { std::ffi::CStr::from_ptr(libc::gnu_get_libc_version()) };
    Some(format!("glibc {}", version.to_string_lossy()))
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
fn c_library() -> Option<String> {
    None
}

/// The processor, its cores and the widest vectors that loops are compiled for.
pub(super) fn processor() -> Finding {
    let model = std::fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
        let line = text.lines().find(|line| line.starts_with("model name"))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    });
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    let model = model.unwrap_or_else(|| std::env::consts::ARCH.to_owned());
    Finding::of("processor", format!("{model}, {cores} cores for this program, {}", vectors()))
}

#[cfg(target_arch = "x86_64")]
fn vectors() -> &'static str {
    match (is_x86_feature_detected!("avx512f"), is_x86_feature_detected!("avx2")) {
        (true, _) => "AVX-512",
        (false, true) => "AVX2",
        _ => "SSE2 only",
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn vectors() -> &'static str {
    "vectors of the baseline"
}

/// Memory that there is, and that this program can have now.
pub(super) fn memory() -> Finding {
    let memory = machine_memory();
    let bytes = |bytes: Option<u64>| bytes.map_or_else(|| UNKNOWN.to_owned(), human_bytes);
    let found = format!("{}, {} available to this program", bytes(memory.total_bytes), bytes(memory.available_bytes));
    match memory.available_bytes {
        Some(_) => Finding::of("memory", found),
        None => Finding::without("memory", found, "jobs cannot tell what memory there is: give them --memory"),
    }
}

/// Room in this folder and for temporary files.
pub(super) fn disk() -> Finding {
    let free = |path: &Path| free_bytes(path).map_or_else(|_| UNKNOWN.to_owned(), human_bytes);
    let temporary = std::env::temp_dir();
    let found =
        format!("{} free in this folder, {} in {}", free(Path::new(".")), free(&temporary), temporary.display());
    Finding::of("disk", found)
}

/// Every adapter with its driver.
#[cfg(feature = "gpu")]
pub(super) fn gpu() -> Finding {
    let driver = |driver: String| if driver.is_empty() { String::new() } else { format!(", driver {driver}") };
    let adapters = ltm::relight::GpuAdapter::all();
    let is_hardware = adapters.iter().any(|(adapter, _)| !adapter.is_software);
    let named: Vec<String> = adapters
        .into_iter()
        .map(|(adapter, of)| {
            let kind = if adapter.is_software { ", in software" } else { "" };
            format!("{}{kind}{}", adapter.name, driver(of))
        })
        .collect();
    match (named.is_empty(), is_hardware) {
        (false, true) => Finding::of("gpu", named.join("; ")),
        (false, false) => {
            Finding::without("gpu", named.join("; "), "no hardware GPU: relighting runs on the CPU, which works")
        }
        (true, _) => {
            let missing = format!(
                "no GPU: relighting runs on the CPU; ltm view wants a driver: {}, or mesa-vulkan-drivers (in software)",
                if is_loadable("libvulkan.so.1") { "the GPU's own" } else { "the loader libvulkan1 and the GPU's own" }
            );
            Finding::without("gpu", "none by Vulkan, Metal or DX12", missing)
        }
    }
}

#[cfg(not(feature = "gpu"))]
pub(super) fn gpu() -> Finding {
    Finding::without("gpu", "this program was built without", "relighting on a GPU: build with the feature gpu")
}

/// Libraries that a window on X11 or Wayland loads while it runs, and Debian's packages of them.
const WINDOW_LIBRARIES: [(&str, &str); 5] = [
    ("libX11.so.6", "libx11-6"),
    ("libX11-xcb.so.1", "libx11-xcb1"),
    ("libXcursor.so.1", "libxcursor1"),
    ("libXi.so.6", "libxi6"),
    ("libxkbcommon-x11.so.0", "libxkbcommon-x11-0"),
];

/// The display and what a window needs of it.
pub(super) fn display() -> Finding {
    if !cfg!(target_os = "linux") {
        return Finding::of("display", "the desktop's own");
    }
    let set = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
    let displays: Vec<String> = ["WAYLAND_DISPLAY", "DISPLAY"]
        .into_iter()
        .filter_map(|name| set(name).map(|value| format!("{name}={value}")))
        .collect();
    let lacking: Vec<&str> =
        WINDOW_LIBRARIES.iter().filter(|(library, _)| !is_loadable(library)).map(|(_, package)| *package).collect();
    let libraries = match &*lacking {
        [] => "all of X11's libraries".to_owned(),
        lacking => format!("X11's libraries without {}", lacking.join(" ")),
    };
    let found = if displays.is_empty() { "none".to_owned() } else { displays.join(", ") };
    let found = format!("{found}; {libraries}");
    match (displays.is_empty(), lacking.is_empty()) {
        (false, true) => Finding::of("display", found),
        (true, _) => Finding::without("display", found, "ltm view: a display (DISPLAY or WAYLAND_DISPLAY is not set)"),
        (false, false) => {
            Finding::without("display", found, format!("ltm view: on Debian, apt-get install {}", lacking.join(" ")))
        }
    }
}

/// Whether the system's loader finds a library.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn is_loadable(library: &str) -> bool {
    let Ok(name) = std::ffi::CString::new(library) else { return false };
    #[expect(unsafe_code, reason = "the loader is asked through the C interface only")]
    // SAFETY: the name is a text that ends in zero; libraries of the system run what they run when any program loads them.
    let handle = unsafe { libc::dlopen(name.as_ptr(), libc::RTLD_LAZY) };
    !handle.is_null()
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
fn is_loadable(_library: &str) -> bool {
    true
}
