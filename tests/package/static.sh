# shellcheck shell=bash disable=SC2016,SC2034,SC2154
# The package in a system whose systemd does not run, as in a chroot or a container: what is where, and whose; the unit as
# systemd's own tools see it; completions; manual; the device names; and that a purge leaves nothing.

# Every file with type, owner and mode, but what package managers and caches write about what they do.
files() {
  (cd "$1" && find . -xdev \( -path ./proc -o -path ./sys -o -path ./dev -o -path ./tmp -o -path ./run -o -path ./var/cache \
    -o -path ./var/log -o -path ./var/lib/apt -o -path ./var/lib/dpkg \) -prune -o -printf '%y %u:%g %m %p\n' | sort)
}

# mode_of FILE: type, owner, group and mode.
mode_of() { stat -c '%F %U:%G %a' "$1"; }

installed_without_systemd() {
  local before user left
  in_root "$root" apt-get -qq update
  # What the package depends on stays when it goes.
  cp "$deb" "$root/plenalign.deb"
  apt_in install --download-only /plenalign.deb
  before=$(files "$root")
  apt_in install --no-install-recommends /plenalign.deb

  is "dpkg finds every file as packed" "$(in_root "$root" dpkg --verify plenalign)" ""
  user=$(in_root "$root" getent passwd plenalign)
  has "the user cannot log in and lives in its state folder" "$user" ':/var/lib/plenalign:/usr/sbin/nologin$'
  has "the user may use serial ports" "$(in_root "$root" id -nG plenalign)" '\bdialout\b'
  has "the user may use cameras" "$(in_root "$root" id -nG plenalign)" '\bvideo\b'
  owned() { in_root "$root" stat -c '%U:%G %a' "$1"; }
  is "the program" "$(owned /usr/bin/plenalign)" "root:root 755"
  is "the state folder is the daemon's" "$(owned /var/lib/plenalign)" "plenalign:plenalign 750"
  is "the configuration's folder can be written by the daemon" "$(owned /etc/plenalign)" "root:plenalign 2775"
  is "the configuration" "$(owned /etc/plenalign/plenalign.toml)" "root:root 644"
  is "both configuration files are kept by dpkg" \
    "$(in_root "$root" dpkg-query -W -f='${Conffiles}\n' plenalign | awk 'NF { print $1 }' | sort | xargs)" \
    "/etc/default/plenalign /etc/plenalign/plenalign.toml"
  is "the service is enabled" "$(in_root "$root" systemctl is-enabled plenalign)" enabled
  is "the state folder is found by its user" \
    "$(in_root "$root" runuser -u plenalign -- plenalign token list --json >/dev/null && owned /var/lib/plenalign)" \
    "plenalign:plenalign 750"
  in_root "$root" runuser -u plenalign -- plenalign token create --name probe --scope view >/dev/null
  is "its keys are its own" "$(owned /var/lib/plenalign/tokens.json)" "plenalign:plenalign 600"
  in_root "$root" plenalign --config /etc/plenalign/plenalign.toml design --json | jq -e '.origin' >/dev/null ||
    fail "the packaged configuration cannot be read"
  ok "the packaged configuration is read"

  unit_is_tight
  completions_load
  manual_renders
  devices_have_names

  echo '# edited' >>"$root/etc/plenalign/plenalign.toml"
  apt_in remove plenalign
  [[ -f $root/etc/plenalign/plenalign.toml && -f $root/var/lib/plenalign/tokens.json ]] ||
    fail "a removal takes configuration or state with it"
  [[ ! -e $root/usr/bin/plenalign ]] || fail "a removal leaves the program"
  ok "a removal keeps configuration and state"
  apt_in purge plenalign
  # The user stays, as users do in Debian: its entries in these files, and their backups. What else is left?
  left=$(diff <(echo "$before") <(files "$root") |
    grep -vE ' \./etc/(passwd|group|shadow|gshadow|subuid|subgid)-?$| \./etc/\.pwd\.lock$| \./(etc|var/lib)$' |
    grep '^[<>]' || true)
  is "a purge leaves nothing" "$left" ""
}

unit_is_tight() {
  local found exposure
  found=$(in_root "$root" systemd-analyze verify --man=yes /usr/lib/systemd/system/plenalign.service 2>&1) ||
    fail "systemd-analyze verify: $found"
  # Debian's own units have things to say, too.
  is "systemd-analyze verify has nothing to say" "$(grep -i plenalign <<<"$found" || true)" ""
  exposure=$(in_root "$root" systemd-analyze security --offline=true --no-pager plenalign.service |
    sed -n 's/.*Overall exposure level for plenalign.service: \([0-9.]*\).*/\1/p')
  [[ $exposure ]] || fail "systemd-analyze security says no exposure level"
  awk -v found="$exposure" 'BEGIN { exit !(found < 3) }' || fail "the unit's exposure level is $exposure, not below 3"
  ok "its exposure level is $exposure"
}

completions_load() {
  local offered
  # As a shell does it that is asked to complete `plenalign ser`, and the option that follows.
  offered=$(in_root "$root" bash -c '
    . /usr/share/bash-completion/bash_completion
    _completion_loader plenalign
    complete=$(complete -p plenalign)
    [[ $complete =~ -F\ ([^ ]+) ]] || exit 1
    offer() { COMP_WORDS=(plenalign "$@"); COMP_CWORD=$#; COMPREPLY=(); "${BASH_REMATCH[1]}" plenalign "${!#}" plenalign; echo "${COMPREPLY[@]}"; }
    offer ser; offer serve --sim; offer token cr')
  is "bash completes" "$(xargs <<<"$offered")" "serve --simulated create"
  in_root "$root" zsh -n /usr/share/zsh/vendor-completions/_plenalign || fail "zsh does not read its completions"
  has "zsh finds its completions" \
    "$(in_root "$root" zsh -fc 'fpath=(/usr/share/zsh/vendor-completions $fpath); autoload -Uz compinit; compinit -D; echo $_comps[plenalign]')" \
    '^_plenalign$'
  has "fish completes" "$(in_root "$root" env HOME=/tmp fish -c 'complete -C "plenalign ser"')" '^serve\b'
}

manual_renders() {
  local page warnings count=0
  for page in "$root"/usr/share/man/man1/plenalign*.1.gz; do
    page=/usr/share/man/man1/$(basename "$page")
    warnings=$(in_root "$root" env MANWIDTH=100 man --warnings --local-file "$page" 2>&1 >/dev/null)
    [[ -z $warnings ]] || fail "$page: $warnings"
    count=$((count + 1))
  done
  is "every command has a page" "$count" "$(in_root "$root" bash -c 'plenalign man /tmp/man | cut -d" " -f1; rm -r /tmp/man')"
  has "man finds them" "$(in_root "$root" env MANWIDTH=100 man plenalign-token-create | col -b)" '--scope'
}
