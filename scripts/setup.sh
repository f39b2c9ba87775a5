# Sourced by the other scripts: checks for the tools that the build needs, and installs packages.
# need_packages PACKAGE...   installs missing Debian packages (as root, or through sudo)
# need_component NAME CMD    stops when the toolchain lacks the component
# need_cargo                 stops with a hint when there is no recent Rust toolchain

# Scripts expect builds in target, even when the user's Cargo settings name another folder.
unset CARGO_TARGET_DIR CARGO_BUILD_TARGET_DIR

need_packages() {
    local missing=() package
    for package in "$@"; do
        dpkg-query --show --showformat='${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing+=("$package")
    done
    [ ${#missing[@]} -eq 0 ] && return
    echo "installing Debian packages: ${missing[*]}"
    local as_root=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || {
            echo "these Debian packages are missing: ${missing[*]}" >&2
            echo "install them as root: apt-get install ${missing[*]}" >&2
            exit 1
        }
        as_root=(sudo)
    fi
    "${as_root[@]}" apt-get update -q
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "${missing[@]}"
}

need_cargo() {
    local version=0
    command -v cargo >/dev/null && version=$(rustc --version | sed -E 's/^rustc 1\.([0-9]+).*/\1/')
    [ "$version" -ge 89 ] 2>/dev/null && return
    echo "a Rust toolchain of version 1.89 or newer is needed (Debian 12's own is older): install one, for example with rustup," >&2
    echo "and run this again" >&2
    exit 1
}

# Checks for a component that minimal toolchains lack: need_component NAME CARGO_SUBCOMMAND
need_component() {
    cargo "$2" --version >/dev/null 2>&1 && return
    echo "the toolchain has no $1, without which this is no check: install it, for example with \`rustup component add $1\`" >&2
    exit 1
}

TOOL_PACKAGES=(build-essential)
# The tools, and OpenCV to read videos.
BUILD_PACKAGES=("${TOOL_PACKAGES[@]}" pkg-config clang libclang-dev libopencv-dev opencv-data)
BROWSER_PACKAGES=(chromium chromium-driver)
WORKFLOW_PACKAGES=(python3 python3-venv)
PYTHON_PACKAGES=(python3 python3-venv)
