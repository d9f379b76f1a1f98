# Programs taken out of Debian's packages, sourced by the scripts that run them: installed, some would have a server
# running on this machine.

# unpack_debian NAME FILE PACKAGE...   puts the packages' files below target/NAME, unless FILE is there already
unpack_debian() {
  local name=$1 file=$2 folder=$root/target/$1 package
  shift 2
  [[ ! -e $folder/$file ]] || return 0
  echo "$name: unpacking Debian's $*"
  rm -rf "$folder"
  mkdir -p "$folder/packages"
  (
    cd "$folder/packages"
    if ! apt-get download "$@" >../log 2>&1; then
      as_root=()
      [[ $(id -u) == 0 ]] || as_root=(sudo)
      "${as_root[@]}" apt-get update >../log 2>&1 && apt-get download "$@" >>../log 2>&1 || {
        tail -n 20 ../log >&2
        exit 1
      }
    fi
    for package in *.deb; do
      dpkg-deb --extract "$package" "$folder"
    done
  )
  rm -r "$folder/packages"
}
