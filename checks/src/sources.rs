//! Hashes of the sources by git: of a commit, and of the files as they are today.

use std::collections::BTreeMap;
use std::error::Error;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A clone with git.
#[derive(Debug, Clone)]
pub struct Checkout {
    root: PathBuf,
}

impl Checkout {
    /// Opens the repository at `root`. Fails with the reason if there is none, such as in an
    /// archive of the sources, or if git is not installed.
    ///
    /// # Errors
    /// If `root` is not the top of a clone that git can read.
    pub fn open(root: &Path) -> Result<Self, Box<dyn Error>> {
        let clone = Self { root: root.to_owned() };
        let top = clone.git(&[], ["rev-parse", "--show-toplevel"])?;
        if Path::new(&top).canonicalize()? != root.canonicalize()? {
            return Err(format!("{} lies within the clone {top}, and is none itself", root.display()).into());
        }
        Ok(clone)
    }

    fn git<S: AsRef<OsStr>>(
        &self,
        variables: &[(&str, &Path)],
        arguments: impl IntoIterator<Item = S>,
    ) -> Result<String, Box<dyn Error>> {
        let mut command = Command::new("git");
        command.arg("-C").arg(&self.root).args(arguments).envs(variables.iter().copied());
        let output = command.output().map_err(|e| format!("git cannot be run: {e}"))?;
        match output.status.success() {
            true => Ok(String::from_utf8(output.stdout)?.trim_end().to_owned()),
            false => Err(format!("git: {}", String::from_utf8_lossy(&output.stderr).trim()).into()),
        }
    }

    /// Returns the current commit.
    ///
    /// # Errors
    /// If there is none yet.
    pub fn commit(&self) -> Result<String, Box<dyn Error>> {
        self.git(&[], ["rev-parse", "HEAD"])
    }

    /// Returns whether the clone has a commit. A shallow one lacks the older ones.
    pub fn has(&self, commit: &str) -> bool {
        self.git(&[], ["cat-file", "-e", &format!("{commit}^{{commit}}")]).is_ok()
    }

    /// Returns the hashes of paths at a commit or in a tree, without those that are not there.
    pub fn hashes<'a>(&self, commit: &str, paths: impl IntoIterator<Item = &'a str>) -> BTreeMap<String, String> {
        self.hashes_in(&[], commit, paths)
    }

    fn hashes_in<'a>(
        &self,
        variables: &[(&str, &Path)],
        tree: &str,
        paths: impl IntoIterator<Item = &'a str>,
    ) -> BTreeMap<String, String> {
        let hash = |path: &str| self.git(variables, ["rev-parse", "--verify", &format!("{tree}:{path}")]).ok();
        paths.into_iter().filter_map(|path| Some((path.to_owned(), hash(path)?))).collect()
    }

    /// Returns the hashes that the files of today would have if they were committed, without those
    /// that git ignores. Neither the clone's index nor its objects change.
    ///
    /// # Errors
    /// If git or the folder for temporary files refuse.
    pub fn today<'a>(
        &self,
        paths: impl IntoIterator<Item = &'a str>,
    ) -> Result<BTreeMap<String, String>, Box<dyn Error>> {
        let folder = tempfile::tempdir()?;
        let (index, objects) = (folder.path().join("index"), folder.path().join("objects"));
        std::fs::create_dir(&objects)?;
        let own = self.root.join(self.git(&[], ["rev-parse", "--git-path", "objects"])?);
        let variables = [
            ("GIT_INDEX_FILE", index.as_path()),
            ("GIT_OBJECT_DIRECTORY", objects.as_path()),
            ("GIT_ALTERNATE_OBJECT_DIRECTORIES", own.as_path()),
        ];
        self.git(&variables, ["read-tree", "HEAD"])?;
        let paths: Vec<&str> = paths.into_iter().collect();
        let there = paths.iter().copied().filter(|path| self.root.join(path).exists());
        self.git(&variables, ["add", "--all", "--"].into_iter().chain(there.clone()))?;
        let tree = self.git(&variables, ["write-tree"])?;
        Ok(self.hashes_in(&variables, &tree, there))
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn clone() -> (tempfile::TempDir, Checkout) {
        let folder = tempfile::tempdir().expect("a folder");
        let clone = Checkout { root: folder.path().to_owned() };
        let at = |path: &str| folder.path().join(path);
        fs::create_dir_all(at("crates/a")).expect("a folder");
        fs::create_dir_all(at("crates/b")).expect("a folder");
        for path in ["crates/a/lib.rs", "crates/b/lib.rs"] {
            fs::write(at(path), "fn f() {}\n").expect("written");
        }
        fs::write(at(".gitignore"), "target\n").expect("written");
        clone.git(&[], ["init", "--quiet"]).expect("a repository");
        clone.git(&[], ["add", "--all"]).expect("added");
        let name = ["-c", "user.name=t", "-c", "user.email=t@localhost"];
        clone.git(&[], name.into_iter().chain(["commit", "--quiet", "-m", "a"])).expect("a commit");
        (folder, clone)
    }

    #[test]
    fn hashes_of_today_follow_the_files() {
        let (folder, clone) = clone();
        let commit = clone.commit().expect("a commit");
        let paths = ["crates/a", "crates/b", "crates/none"];
        let then = clone.hashes(&commit, paths);
        assert_eq!(then.keys().collect::<Vec<_>>(), ["crates/a", "crates/b"]);
        assert_eq!(clone.today(paths).expect("today"), then);
        // A file that git ignores changes nothing, a new one does.
        fs::create_dir(folder.path().join("crates/a/target")).expect("a folder");
        fs::write(folder.path().join("crates/a/target/x"), "x").expect("written");
        assert_eq!(clone.today(paths).expect("today"), then);
        fs::write(folder.path().join("crates/a/more.rs"), "x").expect("written");
        let now = clone.today(paths).expect("today");
        assert_ne!(now["crates/a"], then["crates/a"]);
        assert_eq!(now["crates/b"], then["crates/b"]);
        // Nothing was added to the clone itself.
        assert!(clone.git(&[], ["status", "--porcelain"]).expect("a status").starts_with("?? "));
        assert_eq!(clone.hashes(&commit, paths), then);
    }

    #[test]
    fn folder_without_git_is_refused() {
        let (folder, _) = clone();
        assert!(Checkout::open(folder.path()).is_ok());
        assert!(Checkout::open(&folder.path().join("crates")).is_err());
        assert!(Checkout::open(tempfile::tempdir().expect("a folder").path()).is_err());
    }
}
