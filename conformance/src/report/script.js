(function(){
var rules=[].slice.call(document.querySelectorAll('details.rule')),buttons=[].slice.call(document.querySelectorAll('.filter button')),
find=document.getElementById('find'),group=document.getElementById('group'),none=document.getElementById('none'),verdict='';
function draw(){var text=find.value.toLowerCase(),shown=0;
rules.forEach(function(r){var show=(!verdict||r.dataset.verdict===verdict)&&(!group.value||r.dataset.group===group.value)&&(!text||r.textContent.toLowerCase().indexOf(text)>=0);r.hidden=!show;if(show)shown++});
none.hidden=shown>0;buttons.forEach(function(b){b.setAttribute('aria-pressed',String(b.dataset.verdict===verdict))})}
buttons.forEach(function(b){b.onclick=function(){verdict=b.dataset.verdict;draw()}});
find.oninput=draw;group.onchange=draw;
function open(){var r=document.getElementById(decodeURIComponent(location.hash.slice(1)));if(r&&r.classList.contains('rule')){if(r.hidden){verdict='';find.value='';group.value='';draw()}r.open=true;r.scrollIntoView()}}
window.addEventListener('hashchange',open);open();draw();
window.addEventListener('beforeprint',function(){rules.forEach(function(r){r.dataset.was=r.open?'1':'';if(/fail|flaky|warning/.test(r.dataset.verdict))r.open=true})});
window.addEventListener('afterprint',function(){rules.forEach(function(r){r.open=r.dataset.was==='1'})});
})();
