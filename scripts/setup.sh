#!/usr/bin/env bash
# Makes ready what `make test` needs, or says what is missing before anything else runs:
# a Rust toolchain, a C compiler, and for the cross-checks QEMU, MuJoCo, libclang (which reads MuJoCo's
# header), and a Python virtual environment. MUJOCO_DIR and LIBCLANG_PATH, when set, stand for
# MuJoCo's and libclang's packages.
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

# Stands for processors without this one's vector units.
[ "$(uname -m)" != x86_64 ] || need qemu-x86_64 qemu-user

# MuJoCo's renderer draws off-screen, in software.
have_library() { # have_library FILE
    compgen -G "/usr/lib/*/$1" >/dev/null || compgen -G "/usr/lib*/$1" >/dev/null
}
have_library libEGL.so.1 || missing+=(libegl1)
have_library libOpenGL.so.0 || missing+=(libopengl0)
have_library dri/swrast_dri.so || missing+=(libgl1-mesa-dri)

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
    if ! { python3 -m venv .venv && .venv/bin/python -m pip install -q --disable-pip-version-check -r "$requirements"; }; then
        echo "setup: could not install the packages of $requirements into .venv; is there a network?" >&2
        echo "setup: without them, 'make format lint docs test-rust' runs all checks but those against MuJoCo, h5py and SciPy" >&2
        exit 1
    fi
    cp "$requirements" "$stamp"
fi
echo "setup: ready"
