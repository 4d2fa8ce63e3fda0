#!/usr/bin/env bash
# Makes ready what `make test` needs, or says what is missing before anything else runs:
# a Rust toolchain, a C compiler, and for the cross-checks QEMU, MuJoCo, libclang (which reads MuJoCo's
# header), and a Python virtual environment. MUJOCO_DIR and LIBCLANG_PATH, when set, stand for
# MuJoCo's and libclang's packages. PyTorch, the largest of all, may be missing: WITHOUT_PYTORCH=1 leaves it out.
set -u
cd "$(dirname "$0")/.."

missing=()
need() { # need COMMAND DEBIAN_PACKAGE
    command -v "$1" >/dev/null 2>&1 || missing+=("$2")
}

if ! command -v cargo >/dev/null 2>&1; then
    echo "setup: no cargo found; install a Rust toolchain with rustup, then run make again" >&2
    exit 1
fi
need cc gcc
need python3 python3
python3 -c 'import ensurepip, venv' 2>/dev/null || missing+=(python3-venv)
[ -n "${MUJOCO_DIR:-}" ] || [ -f /usr/include/mujoco/mujoco.h ] || missing+=(libmujoco-dev)
[ -n "${LIBCLANG_PATH:-}" ] || compgen -G '/usr/lib/llvm-*/lib/libclang.so' >/dev/null || missing+=(libclang-dev)

# The feature `joystick` is compiled and checked; gilrs links to libudev.
if [ "$(uname -s)" = Linux ]; then
    need pkg-config pkg-config
    [ -f /usr/include/libudev.h ] || missing+=(libudev-dev)
fi

# Stands for processors without this one's vector units.
[ "$(uname -m)" != x86_64 ] || need qemu-x86_64 qemu-user

# MuJoCo's renderer draws off-screen, in software.
have_library() { # have_library FILE
    compgen -G "/usr/lib/*/$1" >/dev/null || compgen -G "/usr/lib*/$1" >/dev/null
}
have_library libEGL.so.1 || missing+=(libegl1)
have_library libOpenGL.so.0 || missing+=(libopengl0)
have_library dri/swrast_dri.so || missing+=(libgl1-mesa-dri)

# librealsense, inside a Python package, links to these.
if [ "$(uname -m)" = x86_64 ]; then
    have_library libusb-1.0.so.0 || missing+=(libusb-1.0-0)
    have_library libudev.so.1 || missing+=(libudev1)
    libpython=libpython$(python3 -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
    [ "$(command -v python3)" != /usr/bin/python3 ] || have_library "$libpython.so.1.0" || missing+=("$libpython")
fi

if [ ${#missing[@]} -gt 0 ]; then
    echo "setup: missing Debian packages: ${missing[*]}"
    if [ "$(id -u)" -ne 0 ] || ! command -v apt-get >/dev/null 2>&1; then
        echo "setup: not root, or no apt-get here; install them and run make again:" >&2
        echo "    sudo apt-get install ${missing[*]}" >&2
        exit 1
    fi
    if ! { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "${missing[@]}"; }; then
        echo "setup: apt-get could not install ${missing[*]}; is there a network?" >&2
        exit 1
    fi
fi

requirements=tests/python/requirements.txt
stamp=.venv/requirements.installed
if ! cmp -s "$requirements" "$stamp"; then
    echo "setup: making the Python environment .venv"
    # uv downloads and unpacks many packages at a time.
    uv=$(grep '^uv' "$requirements")
    if ! { python3 -m venv .venv && .venv/bin/python -m pip install -q --disable-pip-version-check "$uv" &&
        .venv/bin/uv pip install -q --python .venv/bin/python -r "$requirements"; }; then
        echo "setup: could not install the packages of $requirements into .venv; is there a network?" >&2
        echo "setup: without them, 'make format lint docs test-rust' runs all checks but those against MuJoCo, h5py and SciPy" >&2
        exit 1
    fi
    cp "$requirements" "$stamp"
fi

# Its wheel for CPUs (200 MB) is not where other packages are; uv knows the place. Where that cannot be reached, the usual one
# brings the libraries of a GPU with it.
install_pytorch() {
    echo "setup: installing PyTorch for CPUs"
    .venv/bin/uv pip install -q --python .venv/bin/python --torch-backend cpu -r "$pytorch" && return
    local free_gb=$(($(df -Pk .venv | awk 'END { print $4 }') / 1000000))
    if [ "$free_gb" -lt "$pytorch_gb" ]; then
        echo "setup: no wheel for CPUs, and $free_gb GB of disk are free of the $pytorch_gb that the other one takes" >&2
        return 1
    fi
    echo "setup: no wheel for CPUs within reach; taking the one for GPUs ($pytorch_gb GB, minutes)"
    # Unpacked beside the environment it is linked into place, not copied; of a cache elsewhere the disk would hold both.
    .venv/bin/uv pip install -q --python .venv/bin/python --cache-dir .venv/uv-cache -r "$pytorch"
    local status=$?
    rm -rf .venv/uv-cache
    return $status
}

pytorch=tests/python/requirements-torch.txt
pytorch_stamp=.venv/requirements-torch.installed
pytorch_gb=6 # 5.3 at its highest.
if [ -z "${WITHOUT_PYTORCH:-}" ] && ! cmp -s "$pytorch" "$pytorch_stamp"; then
    if install_pytorch; then
        cp "$pytorch" "$pytorch_stamp"
    else
        echo "setup: PyTorch could not be installed; its types and the tests that compare with it will be skipped" >&2
    fi
fi
echo "setup: ready"
